// SPDX-License-Identifier: Apache-2.0
//
// A profile as JSON: the file that `urgengo profile` writes, and the same object inside the
// resolved config. Times are integer nanoseconds.
//
//   {"format_version":1, "gpu":"..", "driver":"..", "chains":[{"name":"C0", "tasks":[
//     {"name":"detect3d", "cpu_time_ns":N, "kernels":[
//       {"name":"conv", "grid_blocks":N, "block_threads":N, "gpu_time_ns":N,
//       "utilization":0.5}]}]}]}
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "host/config/config.h"
#include "host/config/json_cursor.h"

namespace urgengo::config {

nlohmann::json profile_to_json(const Profile& profile);

/// What is wrong with the JSON is noted in the cursor's fault.
Profile profile_from_json(const JsonCursor& root);

}  // namespace urgengo::config
