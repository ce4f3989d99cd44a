// SPDX-License-Identifier: Apache-2.0
//
// Work that no mark can tell of: between the fork and the join of a task over several streams none
// vouches for what was launched (progress/stream_graph.h). It goes by time instead:
//
//   1 The GPU takes up a launch when it is made, or when the one before has had its time. By then,
//     and its estimate more, it has executed, if the task is first there; beside a more urgent one
//     it is taken to need twice the time.
//   2 It is behind one mark, the last that was issued before it. Nothing of it began before that
//     mark was seen executed.
//   3 It ends where the next mark comes, behind the join, or is still to come. That mark tells of
//     all of it at once, and late: until then time goes on telling.
//
//   4 What marks of single branches have told by the next launch is not left (fork_progress.h).
//
// So what remains of a long fork falls as it executes. Only that: what is launched still counts as
// launched, to whatever ranks or waits.
//
// Of several forks that are under way at once, the last one goes by time.
//
// Pure but for the slot's words. @threads `launched()`: the one that has the task; the rest any
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>

#include "host/model/marked_time.h"

namespace urgengo::model {

using std::chrono::nanoseconds;

class UnmarkedWork {
  public:
    /// A launch was made that no mark vouches for, or one behind such launches before there is a
    /// mark behind them.
    /// @param open      GPU time of all since that mark
    /// @param executed  of it, what marks of branches have told (fork_progress.h)
    /// @param mark      the last one that was issued
    void launched(nanoseconds now, nanoseconds open, nanoseconds executed, bool is_first,
                  std::uint32_t mark) {
        if (mark != mark_) open_ = nanoseconds{0};
        mark_ = mark;
        // It may have been found executed without another mark.
        const nanoseconds next = open < open_ ? open : open - open_;
        const int times = is_first ? 1 : 2;
        until_ = std::min(std::max(until_, now) + times * next, now + times * (open - executed));
        open_ = open;
    }
    /// By when all of it should have executed; 0: there is none.
    nanoseconds until() const { return until_; }
    /// @returns whether there is any, and no mark behind it
    bool is_last(std::uint32_t issued) const { return until_.count() != 0 && mark_ == issued; }
    /// @param done  the last mark that was seen executed
    /// @returns whether the GPU is past it: that one is behind it
    bool is_over(std::uint32_t done) const { return static_cast<std::int32_t>(done - mark_) > 0; }

    /// For the slot: `until()` to 256 ns, and in the low bits the mark that it is behind.
    std::int64_t word() const { return until_.count() == 0 ? 0 : MarkedTime::word(until_, mark_); }
    /// @param done  the last mark that was seen executed
    /// @returns whether there is any, and it may be under way
    static constexpr bool may_be_under_way(std::int64_t word, std::uint32_t done) {
        return MarkedTime::is_of(word, done);
    }
    static constexpr nanoseconds until(std::int64_t word) { return MarkedTime::time(word); }

    /// @param open      GPU time of it
    /// @param progress  when the mark before it was seen executed
    /// @returns how much of it is left
    static constexpr nanoseconds left(nanoseconds open, nanoseconds until, nanoseconds progress,
                                      nanoseconds now) {
        const nanoseconds end = std::max(until, progress + open);
        return std::clamp(end - now, nanoseconds{0}, open);
    }

  private:
    nanoseconds until_{0}, open_{0};
    std::uint32_t mark_ = 0;
};

}  // namespace urgengo::model
