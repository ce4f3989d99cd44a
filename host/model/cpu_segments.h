// SPDX-License-Identifier: Apache-2.0
//
// How long a task's CPU segments take: the paper's E^cpu_j (section 4.2.1), "moving averages across
// recent instances", and the sum over those that are still to come, for Eq. 2.
//
// The average is the plain mean of the first kWindow instances, then moves by 1 / kWindow of what
// each one differs. A profile's value counts as one instance. A time beyond kMostTimes the average
// and kMostMore counts as that: a program that was stopped for a while is not slow from then on.
//
// Storage grows in end_instance() only. Owner thread only (TaskState::busy).
#pragma once

#include <chrono>
#include <cstdint>
#include <span>
#include <vector>

namespace urgengo::model {

using std::chrono::nanoseconds;

class CpuSegments {
  public:
    static constexpr std::uint32_t kWindow = 8;
    static constexpr std::size_t kMaxSegments = 1024;
    static constexpr int kMostTimes = 4;
    static constexpr nanoseconds kMostMore{1'000'000};

    explicit CpuSegments(std::span<const nanoseconds> profile = {});

    /// A CPU segment took so long. Does not allocate: a segment that is new is counted from the
    /// next instance on.
    void observe(std::size_t segment, nanoseconds time);

    /// Ends an instance of so many segments: brings the sums up to date. Allocates.
    void end_instance(std::size_t num_segments);

    nanoseconds estimate(std::size_t segment) const {
        return segment < segments_.size() ? nanoseconds(segments_[segment].mean_ns)
                                          : nanoseconds{0};
    }
    /// @returns CPU time of the segments after this one, as of the last instance's end
    nanoseconds after(std::size_t segment) const {
        return segment < segments_.size() ? nanoseconds(segments_[segment].later_ns)
                                          : nanoseconds{0};
    }
    /// @returns CPU time of all segments, as of the last instance's end
    nanoseconds total() const { return estimate(0) + after(0); }
    std::size_t size() const { return segments_.size(); }

  private:
    struct Segment {
        std::int64_t mean_ns = 0;
        std::int64_t later_ns = 0;
        std::uint32_t instances = 0;
    };
    void sum_up();

    std::vector<Segment> segments_;
};

}  // namespace urgengo::model
