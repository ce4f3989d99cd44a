// SPDX-License-Identifier: Apache-2.0
//
// A run in other tools' formats.
#pragma once

#include <string>

#include "tools/trace/run_story.h"

namespace urgengo::trace {

/// @returns Perfetto's protobuf (perfetto.dev, protos/perfetto/trace): what run_timeline.h draws,
///          with a snapshot of CLOCK_MONOTONIC and CLOCK_REALTIME, and some of the GPU's clock (64)
std::string to_perfetto(const Run& run, const RunStory& story);

/// @returns Chrome's trace event format, JSON: the same; for ui.perfetto.dev, chrome://tracing,
///          Speedscope
std::string to_chrome(const Run& run, const RunStory& story);

/// @returns a line a frame, slice, mark, priority and mode, in the order of their begins
std::string to_csv(const Run& run, const RunStory& story);

}  // namespace urgengo::trace
