// SPDX-License-Identifier: Apache-2.0
//
// TH_urgent (section 4.4.3 of the paper): a percentile of the highest urgencies among the tasks on
// the GPU, recorded from time to time. Kept as laxities (an urgency is one over a laxity, so its
// high percentiles are the laxities' low ones), counted in a histogram (urgent_steps.h). The GPU's
// dispatcher keeps another one, of its rounds (device/dispatch_round.cuh).
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <optional>

#include "urgengo/abi/dispatcher.h"

namespace urgengo::sched {

using std::chrono::nanoseconds;

class UrgentThreshold {
  public:
    /// Urgencies are recorded this far apart, as the paper's evaluation does; before so many there
    /// is no threshold, and it is reckoned anew after so many more.
    static constexpr nanoseconds kEvery{abi::kUrgentEvery_ns};
    static constexpr std::uint32_t kEnough = abi::kUrgentEnough;

    /// @param percentile  of urgencies: 95
    explicit UrgentThreshold(double percentile) : percentile_(percentile) {}

    /// @returns whether kEvery has passed since the last record, and this caller is to make one
    /// @threads any
    bool is_due(nanoseconds now);
    /// @param laxity  the least of those on the GPU that are not negative
    /// @threads any; takes no lock
    void record(nanoseconds laxity);
    /// @returns the laxity under which a task is truly urgent
    /// @threads any
    std::optional<nanoseconds> laxity() const;

  private:
    void reckon();

    const double percentile_;
    std::atomic<nanoseconds> last_{nanoseconds{-1'000'000'000}};
    std::atomic<std::uint32_t> num_records_{0};
    std::atomic<std::int64_t> laxity_ns_{-1};  ///< -1: none yet
    std::array<std::atomic<std::uint32_t>, abi::kUrgentSteps> counts_{};
};

}  // namespace urgengo::sched
