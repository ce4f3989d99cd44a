// SPDX-License-Identifier: Apache-2.0
//
// What the config's numbers may be: checked by the YAML reader and again where the resolved
// JSON is read, which may have been edited by hand.
#pragma once

#include <cstddef>
#include <cstdint>

namespace urgengo::config {

template <typename T>
struct Range {
    T min;
    T max;
};

inline constexpr std::size_t kMaxChains = 256;
inline constexpr std::size_t kMaxTasks = 256;  ///< over all chains

/// A day: far beyond any period, and far from overflowing 64-bit nanoseconds.
inline constexpr double kMaxTimeMs = 86'400'000;
inline constexpr std::int64_t kMaxTimeNs = 86'400'000'000'000;

inline constexpr Range<double> kPackLimit{0.1, 10};
inline constexpr Range<std::int64_t> kShareSlackUs{0, 86'400'000'000};  ///< a day: never
inline constexpr Range<std::int64_t> kNice{-20, -1};
inline constexpr Range<std::int64_t> kPriorityLevels{0, 64};  ///< 0: all that the device has
inline constexpr Range<std::int64_t> kLaunchers{0, 256};
inline constexpr Range<double> kLambda{-100, 100};
inline constexpr Range<double> kPlanMargin{0, 10};
inline constexpr Range<double> kExemptUtilization{0, 1};
inline constexpr Range<double> kUrgentPercentile{1, 100};
inline constexpr Range<std::int64_t> kQuantumUs{50, 100'000};
inline constexpr Range<std::int64_t> kCriticality{0, 1000};
inline constexpr Range<std::int64_t> kMaxConsecutiveMisses{0, 1'000'000};  ///< 0: any number
inline constexpr Range<std::int64_t> kHoldPollUs{10, 10'000};
inline constexpr Range<double> kHoldDeadlines{0.01, 100};
inline constexpr Range<std::int64_t> kMarkEveryUs{0, 10'000};  ///< 0: behind every launch
inline constexpr Range<std::int64_t> kRunAheadUs{50, 100'000};
inline constexpr Range<std::int64_t> kEvalIntervalUs{10, 100'000};
inline constexpr Range<std::int64_t> kConnections{1, 32};
inline constexpr Range<std::int64_t> kLeaseUs{100, 10'000};
inline constexpr Range<std::int64_t> kLeaseIdleUs{20, 10'000};
inline constexpr Range<std::int64_t> kGateGroupUs{20, 100'000};
inline constexpr Range<std::int64_t> kMostGates{1, 15};

/// Of 0, too: not cut. A slice costs its thread a call.
inline constexpr Range<std::int64_t> kCopySliceBytes{65'536, 1'073'741'824};
/// With `hold: on`, where none is written: two of them take 0.38 ms at 55 GB/s.
inline constexpr std::int64_t kDefaultCopySliceBytes = 10'485'760;

}  // namespace urgengo::config
