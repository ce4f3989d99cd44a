// SPDX-License-Identifier: Apache-2.0
//
// The simulated part: its size and speed. The defaults resemble an RTX 3070 Ti (46 SMs of 1536
// threads, compute capability 8.6, PCIe 4.0 x16); the environment may change some (README.md).
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace urgengo::simgpu {

/// A duration, or a point on CLOCK_MONOTONIC (on a test's virtual clock: since its start).
using Time = std::chrono::nanoseconds;

struct Part {
    int num_sms = 46;
    int threads_per_sm = 1536;
    int blocks_per_sm = 16;
    std::size_t memory_bytes = std::size_t{8} << 30;

    Time launch_overhead{2000};  ///< from a kernel's end to the start of the next one in its stream
    Time memop{2000};            ///< a stream write (measured on an H200: 2.0 us)
    Time copy_latency{1000};     ///< what a copy of no bytes takes
    double copy_gbps = 24;       ///< host to device and back, gigabytes per second
    double device_gbps = 300;    ///< device to device, and memset

    double time_scale = 1;  ///< multiplies every simulated duration

    /// @returns the duration scaled, at least 1 ns: no kernel ends when it starts
    Time scaled(double duration_ns) const;
    Time copy_time(std::size_t bytes, double gbps) const;
};

/// Reads SIMGPU_SMS, SIMGPU_TIME_SCALE, SIMGPU_LAUNCH_OVERHEAD_NS and SIMGPU_COPY_GBPS.
/// @param[out] problems  one line for each variable that is refused and keeps its default
Part read_part(std::vector<std::string>& problems);

}  // namespace urgengo::simgpu
