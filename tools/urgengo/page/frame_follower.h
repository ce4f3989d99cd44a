// SPDX-License-Identifier: Apache-2.0
//
// Follows the rings in which a page keeps the last frames of each chain that ended: each frame is
// counted once, however often it is looked, and one that was written over before it was seen is
// counted as unread. The file stays open, so the frames of a process that has just ended are there
// still.
//
// @threads one at a time
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "host/base/file_descriptor.h"
#include "urgengo/abi/status_page.h"

namespace urgengo::cli {

using std::chrono::nanoseconds;

/// Counts of times by the least bound that they are not above.
class TimeHistogram {
  public:
    /// @param bounds  ascending; not owned
    explicit TimeHistogram(std::span<const nanoseconds> bounds)
        : bounds_(bounds), counts_(bounds.size() + 1) {}

    void add(nanoseconds time);
    std::span<const nanoseconds> bounds() const { return bounds_; }
    /// @returns how many are above the bound before that, and not above that; behind the last
    ///          bound, those above all
    std::uint64_t count(std::size_t bound) const { return counts_[bound]; }
    std::uint64_t total() const;
    nanoseconds sum() const { return sum_; }

  private:
    std::span<const nanoseconds> bounds_;
    std::vector<std::uint64_t> counts_;
    nanoseconds sum_{0};
};

/// The frames of a chain that have been seen to end.
struct FollowedFrames {
    FollowedFrames();
    nanoseconds deadline{0};
    std::uint64_t next = 0;    ///< number of the first frame that was not looked for
    std::uint64_t unread = 0;  ///< frames that were written over before they were seen
    TimeHistogram latency;
    TimeHistogram lateness;  ///< beyond the deadline; 0 only of frames in time
};

class FrameFollower {
  public:
    /// @param stem  of the page, without suffix
    /// @returns null if there is no such page, or one without rings
    static std::unique_ptr<FrameFollower> open(const std::string& stem);

    /// Counts what has ended since the last call.
    void follow();

    /// By the page's chains.
    const std::vector<FollowedFrames>& chains() const { return chains_; }
    /// @returns whether the page of that stem is the file that is followed: a process that becomes
    ///          another program has a new one
    bool is_of(const std::string& stem) const;

  private:
    FrameFollower(int fd, const abi::StatusSection& section);
    void follow(std::size_t index);

    FileDescriptor file_;
    abi::StatusSection section_;
    std::vector<FollowedFrames> chains_;
};

}  // namespace urgengo::cli
