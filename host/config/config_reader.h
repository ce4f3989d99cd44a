// SPDX-License-Identifier: Apache-2.0
//
// Reads and validates chains.yaml. Accepts exactly the keys that do something; anything else is an
// error that names the file, the line, the key, what was found and what is accepted.
//
//   version: 1
//   mode: enforce                    # off | observe | enforce
//   chains:
//     - name: lidar_front
//       period_ms: 150
//       deadline_ms: 120
//       on_late: continue            # continue | exit
//       tasks:
//         - {name: detect3d, thread: "pp_*"}
//   scheduler:                       # optional; any key overrides the preset
//     preset: urgengo                # urgengo | vanilla
//     policy: urgency                # urgency | edf
//     binding: kernel                # none | kernel
//     admission: packed              # none | packed
//     pack_limit: 1.05
//     hold: {poll_us: 50, max_deadlines: 2}
//     progress: {every_us: 100}
//     run_ahead_us: 1000
//     run_ahead_alone_us: 4000
//     guard: on                      # on | off
//   env: {connections: auto}         # auto: 32 for more than 6 tasks | 1..32 | keep
//
// For tools: depends on yaml-cpp, which is never loaded into a scheduled program.
#pragma once

#include <string>

#include "host/base/result.h"
#include "host/config/config.h"

namespace urgengo::config {

/// @param preset  replaces the file's `scheduler.preset` if not empty; explicit keys still override
/// @errors one line: file, line, path, found, accepted
Result<Config> read_config(const std::string& path, const std::string& preset = "");

/// The same for a text that was read already; `file` is what errors call it.
Result<Config> parse_config(const std::string& text, const std::string& file,
                            const std::string& preset = "");

}  // namespace urgengo::config
