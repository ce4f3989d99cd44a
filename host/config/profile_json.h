// SPDX-License-Identifier: Apache-2.0
//
// A profile as JSON: the file that `urgengo profile` writes, and the same object inside the
// resolved config. Times are integer nanoseconds. Keys that are not known are ignored, so that a
// profile may carry notes; those marked (o) may be absent.
//
//   {"format_version": 2, "gpu": "NVIDIA H200", "driver": "13.0",
//    "sm_clock_mhz": 1980 (o), "memory_clock_mhz": 3201 (o),   0: not known
//    "program": "my_stack" (o), "kernel_set_hash": "16 hexadecimal digits" (o), "runs": 1 (o),
//    "chains": [{"name": "lidar", "tasks": [
//      {"name": "detect", "cpu_time_ns": N, "instances": N (o), "start_up_launches": N (o),
//       "segments" (o): [{"cpu_time_ns": N, "num_launches": N, "min_launches": N,
//                         "max_launches": N, "closed_by": "stream", "latency_ns": N (o)}],
//       "kernels": [{"name": "conv", "grid_blocks": N, "block_threads": N, "gpu_time_ns": N,
//                    "utilization": 0.5, "samples": N (o), "launch_ns": N (o), "stream": N (o)}],
//       "sizes" (o): [the same]}]}]}
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "host/config/config.h"
#include "host/config/json_cursor.h"

namespace urgengo::config {

nlohmann::ordered_json profile_to_json(const Profile& profile);

/// @returns the text of a profile file: indented, one kernel a line
std::string to_profile_text(const Profile& profile);

/// What is wrong with the JSON is noted in the cursor's fault.
Profile profile_from_json(const JsonCursor& root);

}  // namespace urgengo::config
