// SPDX-License-Identifier: Apache-2.0
//
// The parts to choose from, the environment variables, and the arithmetic.
#include "tools/simgpu/engine/part.h"

#include <algorithm>
#include <cmath>

#include "tools/simgpu/api/environment.h"

namespace urgengo::simgpu {
namespace {

/// As large as an H200, but for its 32 blocks an SM: sm_array.h takes 16.
Part h200() {
    Part part;
    part.name = "UrgenGo Simulated GPU (as an H200)";
    part.compute_major = 9;
    part.compute_minor = 0;
    part.num_sms = 132;
    part.threads_per_sm = 2048;
    part.shared_kb_per_sm = 228;
    part.shared_kb_opt_in = 227;
    part.l2_mb = 60;
    part.clock_khz = 1980000;
    part.memory_clock_khz = 3201000;
    part.memory_bus_bits = 6144;
    part.memory_bytes = std::size_t{140} << 30;
    part.copy_gbps = 55;
    part.device_gbps = 2000;
    return part;
}

/// Like a Jetson Orin: eight SMs beside the host's cores, one memory for both.
Part integrated() {
    Part part;
    part.name = "UrgenGo Simulated GPU (integrated)";
    part.compute_minor = 7;
    part.num_sms = 8;
    part.shared_kb_per_sm = 164;
    part.shared_kb_opt_in = 163;
    part.clock_khz = 918000;
    part.memory_clock_khz = 3200000;
    part.memory_bus_bits = 128;
    part.integrated = true;
    part.programmatic_launch = false;
    part.concurrent_managed = false;
    part.copy_gbps = 30;
    part.device_gbps = 50;
    return part;
}

Part read_device(std::vector<std::string>& problems) {
    switch (read_choice("SIMGPU_DEVICE", {"desktop", "h200", "integrated"}, 0, problems)) {
        case 1:
            return h200();
        case 2:
            return integrated();
        default:
            return {};
    }
}

}  // namespace
Time Part::scaled(double duration_ns) const {
    constexpr double kLongest = 1e18;  // 31 years: keeps the sum of a few within 64 bits
    return Time{std::llround(std::clamp(duration_ns * time_scale, 1.0, kLongest))};
}

Time Part::copy_time(std::size_t bytes, double gbps) const {
    return scaled(static_cast<double>(copy_latency.count()) + static_cast<double>(bytes) / gbps);
}

Part read_part(std::vector<std::string>& problems) {
    Part part = read_device(problems);
    part.num_in_machine = static_cast<int>(
        read_number("SIMGPU_DEVICES", 1, {1, Part::kMostInMachine, true}, problems));
    part.num_sms =
        static_cast<int>(read_number("SIMGPU_SMS", part.num_sms, {1, 1024, true}, problems));
    part.time_scale =
        read_number("SIMGPU_TIME_SCALE", part.time_scale, {1e-3, 1e6, false}, problems);
    part.copy_gbps = read_number("SIMGPU_COPY_GBPS", part.copy_gbps, {1e-3, 1e6, false}, problems);
    part.launch_overhead = Time{static_cast<std::int64_t>(
        read_number("SIMGPU_LAUNCH_OVERHEAD_NS", static_cast<double>(part.launch_overhead.count()),
                    {0, 1e9, true}, problems))};
    constexpr PriorityAttribute kAttribute[] = {
        PriorityAttribute::kHonoured, PriorityAttribute::kIgnored, PriorityAttribute::kRefused};
    part.priority_attribute = kAttribute[read_choice(
        "SIMGPU_PRIORITY_ATTRIBUTE", {"honoured", "ignored", "refused"}, 0, problems)];
    return part;
}

}  // namespace urgengo::simgpu
