// SPDX-License-Identifier: Apache-2.0
//
// Presets: named settings of every key under `scheduler:`. Keys that the user writes override them.
//
//   urgengo        what measures best; the defaults of struct Scheduler
//   urgency, edf, eqdf, saedf, lcuf, sjf, hrrn, static, fifo
//                  the same with that order (host/sched/policies/)
//   paper          the paper's algorithm: task-level binding with a reserved level, delayed
//                  launching, overlapped batches of 0.5 ms
//   paper_binding, paper_delay
//                  of that, the binding or the delayed launching alone (its ablation)
//   paam           PAAM: static order, one request in flight in each bucket of priorities
//   dcuda          dCUDA, as the paper characterises it: groups of complementary occupancy in turn
//   vanilla        intercepts, counts, and answers early exit; schedules nothing
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "host/config/config.h"

namespace urgengo::config {

/// @returns the preset's settings; nothing if no preset has that name
std::optional<Scheduler> preset(std::string_view name);

/// @returns "urgengo", "urgency", "edf", ...
std::vector<std::string> list_presets();

/// @returns "urgengo, urgency, edf, ...", for error messages and help
std::string preset_names();

}  // namespace urgengo::config
