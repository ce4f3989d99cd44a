// SPDX-License-Identifier: Apache-2.0
//
// Which wait ends what a task has launched, where the program leaves something open on a side
// stream.
//
// A wait that covers all launches ends them (stream_graph.h). But some programs never wait for a
// side stream: copies, or kernels that log. Of theirs no wait would ever be the end. So a wait for
// the stream of the last launch is counted when it leaves something open, and nothing covers that
// before the program goes on launching. When that has happened through two instances, such a wait
// is the end for this task, until the program covers everything again by then.
//
// Pure. @threads one at a time: the one that has the task
#pragma once

#include <algorithm>
#include <cstdint>

namespace urgengo::progress {

class ClosingRule {
  public:
    /// Of the last instances, so many have to leave something open.
    static constexpr std::uint32_t kInstances = 2;

    /// @returns whether a wait for the stream of the last launch is one for all
    /// @param waits  in an instance, each for a part of it: segments of the plan; 0: not known
    bool last_stream_ends(std::size_t waits) const {
        return left_open_ >= kInstances * std::max<std::size_t>(waits, 1);
    }
    /// A wait has ended that covers all.
    void all_covered() { left_open_ = 0, waited_at_ = 0; }
    /// A wait for the stream of the last launch has ended, and left something open.
    /// @param launched  so many launches the task has made
    void left_something_open(std::uint64_t launched) {
        if (waited_at_ != 0 && launched > waited_at_) ++left_open_;
        waited_at_ = launched;
    }

  private:
    std::uint32_t left_open_ = 0;  ///< times in a row
    std::uint64_t waited_at_ = 0;  ///< launches at the last of those waits; 0: none
};

}  // namespace urgengo::progress
