// SPDX-License-Identifier: Apache-2.0
//
// chains.yaml as a text with one thing wrong in it, and what the reader says.
#pragma once

#include <string>

#include "host/config/config_reader.h"

#include "host/config/connections.h"
#include "host/config/kernel_pattern.h"
#include "host/config/presets.h"
#include "host/config/progress_choice.h"
#include "tests/support/catch.h"

namespace urgengo::config {

using namespace std::chrono_literals;

inline constexpr char kMinimal[] =
    "version: 1\n"                                // 1
    "chains:\n"                                   // 2
    "  - name: lidar\n"                           // 3
    "    period_ms: 150\n"                        // 4
    "    deadline_ms: 120.5\n"                    // 5
    "    tasks:\n"                                // 6
    "      - {name: detect, thread: \"pp_*\"}\n"  // 7
    "      - {name: track}\n";                    // 8
inline constexpr char kAll[] =
    "mode: observe\n"
    "scheduler:\n"
    "  preset: vanilla\n"
    "  policy: edf\n"
    "  binding: kernel\n"
    "  admission: packed\n"
    "  pack_limit: 0.9\n"
    "  hold: {poll_us: 10, max_per_instance_ms: 2.5}\n"
    "  progress: {source: memop, every_us: 300, learn: on}\n"
    "  run_ahead_us: 2000\n"
    "  run_ahead_alone_us: 5000\n"
    "  priority_via: stream_pool\n"
    "  tracking: overlapped\n"
    "  eval_interval_us: 100\n"
    "cpu: {blocking_sync: on}\n"
    "env: {connections: 8}\n";

/// kMinimal with its line `number` replaced, and `more` after it.
inline std::string with_line(int number, const std::string& line, const std::string& more = "") {
    std::string text = kMinimal;
    std::size_t start = 0;
    for (int i = 1; i < number; ++i) start = text.find('\n', start) + 1;
    return text.replace(start, text.find('\n', start) - start, line) + more;
}

inline std::string error_of(const std::string& yaml, const std::string& preset_override = "") {
    const auto config = parse_config(yaml, "c.yaml", preset_override);
    return config ? "no error" : config.error();
}

/// The error for kMinimal followed by `more`, which starts in line 9.
inline std::string error_with(const std::string& more) {
    return error_of(kMinimal + more);
}

}  // namespace urgengo::config
