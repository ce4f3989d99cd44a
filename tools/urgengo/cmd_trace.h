// SPDX-License-Identifier: Apache-2.0
//
// urgengo trace: what happened in a run, from what `urgengo run --trace` or `urgengo ctl dump` has
// written (tools/trace/run_reader.h).
//
//   info    in numbers
//   why     the story of one frame, in words
//   export  for Perfetto, Chrome, Nsight Systems, or a table
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>

namespace urgengo::cli {

struct TraceOptions {
    std::string what, file;
    bool json = false;
    std::string chain;        ///< of why
    std::uint32_t frame = 0;  ///< of why; 0: the last late one
    bool perfetto = false, chrome = false, csv = false, nsys = false;
    std::string out;  ///< of export
};

CLI::App* add_trace(CLI::App& app, TraceOptions& options);

/// @returns an exit code
int cmd_trace(const TraceOptions& options);

}  // namespace urgengo::cli
