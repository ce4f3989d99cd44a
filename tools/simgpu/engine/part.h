// SPDX-License-Identifier: Apache-2.0
//
// The simulated part: its size, its speed and what it can do. SIMGPU_DEVICE chooses one, other
// variables change some of it (README.md).
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace urgengo::simgpu {

/// A duration, or a point on CLOCK_MONOTONIC (on a test's virtual clock: since its start).
using Time = std::chrono::nanoseconds;

/// What becomes of the priority that a launch carries.
enum class PriorityAttribute { kHonoured, kIgnored, kRefused };

/// The defaults resemble an RTX 3070 Ti on PCIe 4.0 x16.
struct Part {
    static constexpr int kMostInMachine = 4;

    std::string_view name = "UrgenGo Simulated GPU";
    int compute_major = 8;
    int compute_minor = 6;
    int num_sms = 46;
    int threads_per_sm = 1536;
    int blocks_per_sm = 16;
    int shared_kb_per_sm = 100;
    int shared_kb_opt_in = 99;  ///< the most that a block may ask for
    int l2_mb = 4;
    int clock_khz = 1770000;
    int memory_clock_khz = 9501000;
    int memory_bus_bits = 256;
    std::size_t memory_bytes = std::size_t{8} << 30;

    bool integrated = false;          ///< shares its memory with the host
    bool programmatic_launch = true;  ///< else a launch that asks for it is refused
    bool concurrent_managed = true;   ///< the host may touch managed memory while kernels run
    PriorityAttribute priority_attribute = PriorityAttribute::kHonoured;

    Time launch_overhead{2000};  ///< from a kernel's end to the start of the next one in its stream
    Time memop{2000};            ///< a stream write (measured on an H200: 2.0 us)
    Time copy_latency{1000};     ///< what a copy of no bytes takes
    double copy_gbps = 24;       ///< host to device and back, gigabytes per second
    double device_gbps = 300;    ///< device to device, and memset

    int num_in_machine = 1;  ///< devices, all alike, at most kMostInMachine

    double time_scale = 1;  ///< multiplies every simulated duration

    /// @returns the duration scaled, at least 1 ns: no kernel ends when it starts
    Time scaled(double duration_ns) const;
    Time copy_time(std::size_t bytes, double gbps) const;
};

/// Reads SIMGPU_DEVICE, and what changes some of it: SIMGPU_DEVICES, SIMGPU_SMS,
/// SIMGPU_TIME_SCALE, SIMGPU_LAUNCH_OVERHEAD_NS, SIMGPU_COPY_GBPS, SIMGPU_PRIORITY_ATTRIBUTE.
/// @param[out] problems  one line for each variable that is refused and keeps its default
Part read_part(std::vector<std::string>& problems);

}  // namespace urgengo::simgpu
