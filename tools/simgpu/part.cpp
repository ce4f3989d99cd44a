// SPDX-License-Identifier: Apache-2.0
//
// The part's environment variables and its arithmetic.
#include "tools/simgpu/part.h"

#include <algorithm>
#include <cmath>

#include "tools/simgpu/environment.h"

namespace urgengo::simgpu {
Time Part::scaled(double duration_ns) const {
    constexpr double kLongest = 1e18;  // 31 years: keeps the sum of a few within 64 bits
    return Time{std::llround(std::clamp(duration_ns * time_scale, 1.0, kLongest))};
}

Time Part::copy_time(std::size_t bytes, double gbps) const {
    return scaled(static_cast<double>(copy_latency.count()) + static_cast<double>(bytes) / gbps);
}

Part read_part(std::vector<std::string>& problems) {
    Part part;
    part.num_sms =
        static_cast<int>(read_number("SIMGPU_SMS", part.num_sms, {1, 1024, true}, problems));
    part.time_scale =
        read_number("SIMGPU_TIME_SCALE", part.time_scale, {1e-3, 1e6, false}, problems);
    part.copy_gbps = read_number("SIMGPU_COPY_GBPS", part.copy_gbps, {1e-3, 1e6, false}, problems);
    part.launch_overhead = Time{static_cast<std::int64_t>(
        read_number("SIMGPU_LAUNCH_OVERHEAD_NS", static_cast<double>(part.launch_overhead.count()),
                    {0, 1e9, true}, problems))};
    return part;
}

}  // namespace urgengo::simgpu
