// SPDX-License-Identifier: Apache-2.0
//
// The own time of kernels, told from contention by who else was active.
//
//  1 Contention of a launch: the utilisation of other threads' launches, averaged over its time on
//    the GPU. A thread's own launches on other streams are its own doing.
//  2 If at least three launches had (nearly) none, the own time is their median: what is left of
//    contention is within the threshold, and a median heeds no outlier on either side.
//  3 Else it is the lower quartile of the least contended quarter (at least three). Contention only
//    ever lengthens, so that may be too much but, but for noise, not too little; taking it off by a
//    model would risk to be below the truth, and a time that is too short is what makes a chain
//    miss.
#pragma once

#include <cstdint>
#include <vector>

#include "tools/trace/gpu_intervals.h"

namespace urgengo::trace {

/// How busy others kept the GPU, at any time.
class Contention {
  public:
    /// @param intervals  of every thread, as gpu_intervals() returns them; behind them maybe
    ///                   those of launches that were not seen
    explicit Contention(const std::vector<std::vector<GpuInterval>>& intervals);

    /// @returns the summed utilisation of the launches of all other threads, averaged over the
    ///          interval; 0: no other was active
    double of(std::size_t thread, const GpuInterval& interval) const;

  private:
    /// The integral of utilisation over time, linear between the points.
    struct Integral {
        std::vector<std::int64_t> times_ns;
        std::vector<double> busy_ns;
        std::vector<double> slopes;

        double until(std::int64_t time_ns) const;
    };
    struct Change;

    static Integral integrate(std::vector<Change> changes);

    std::vector<Integral> threads_;
    Integral all_;
};

/// One launch of a kernel.
struct KernelSample {
    std::int64_t length_ns = 0;
    double contention = 0;
    /// A guess: a part of several launches' interval (GpuInterval::shared), or some of launching is
    /// in it (GpuInterval::loose).
    bool shared = false;
};

struct OwnTime {
    std::int64_t ns = 0;
    std::uint32_t samples = 0;  ///< that it was learned from
    std::uint32_t clean = 0;    ///< of all, without contention
};

/// Contention below this counts as none.
inline constexpr double kCleanContention = 0.03;
inline constexpr std::size_t kMinCleanSamples = 3;

/// @param samples  of one kernel; may be empty
OwnTime own_time(std::vector<KernelSample> samples);

}  // namespace urgengo::trace
