// SPDX-License-Identifier: Apache-2.0
//
// Work that no mark can tell of: between the fork and the join of a task over several streams none
// vouches for what was launched (progress/stream_graph.h). It goes by time instead:
//
//   1 The GPU takes up a launch when it is made, or when the one before has had its time. By then,
//     and its estimate more, it has executed, if the task is first there; beside a more urgent one
//     it is taken to need twice the time.
//   2 Nothing of it began before the last mark was seen executed, and nothing at all while that is
//     still to come.
//
// So what remains of a long fork falls as it executes. Only that: what is launched still counts as
// launched, to whatever ranks, paces or waits.
//
// Pure but for the slot's words. @threads `launched()`: the one that has the task; the rest any
#pragma once

#include <algorithm>
#include <chrono>

#include "urgengo/abi/shared_page.h"

namespace urgengo::model {

using std::chrono::nanoseconds;

class UnmarkedWork {
  public:
    /// A launch was made that no mark vouches for.
    /// @param open  GPU time of all since the last mark
    void launched(nanoseconds now, nanoseconds open, bool is_first) {
        const nanoseconds next = open < open_ ? open : open - open_;  // there was a mark
        until_ = std::max(until_, now) + (is_first ? next : 2 * next);
        open_ = open;
    }
    /// By when all of it should have executed; 0: there is none.
    nanoseconds until() const { return until_; }

    /// @param open      GPU time of what was launched since the last mark
    /// @param progress  when that mark was seen executed
    /// @returns how much of it is left
    static constexpr nanoseconds left(nanoseconds open, nanoseconds until, nanoseconds progress,
                                      nanoseconds now) {
        const nanoseconds end = std::max(until, progress + open);
        return std::clamp(end - now, nanoseconds{0}, open);
    }

  private:
    nanoseconds until_{0}, open_{0};
};

}  // namespace urgengo::model
