// SPDX-License-Identifier: Apache-2.0
//
// How far the GPU is between the fork and the join of a task over several streams, where no mark
// vouches for all that was launched (progress/stream_graph.h). It is for the task's own run-ahead:
// to the others a fork goes by time (unmarked_work.h).
//
//   1 A mark of a branch is on one stream, and vouches for what is on it. It writes how much GPU
//     time was ever launched there (device_mailbox.h), so that the newest one says all.
//   2 A branch is marked once so much of the fork is open that its length may matter: short forks,
//     such as those of grouped convolutions, cost nothing.
//   3 Once a branch has moved, each is taken to be further than its last mark by as much as may be
//     launched without one. So the task is rather too far ahead than the GPU without work.
//   4 The last launch does not count: so behind a kernel that is longer than the run-ahead there is
//     always another, and the GPU never waits for us between two.
//   5 Where the mark behind a join is under way as the next fork begins, the fork before counts as
//     executed: of it, as it was paced, a run-ahead is left. Only one: what is before that does
//     not.
//   6 A fork is followed on the first kBranches streams that the task uses (StreamGraph::branch());
//     one over others is not. Nor is one that stands still while it is paced: it may be waiting for
//     this very launch.
//
// Pure but for the line's words. @threads the one that has the task; ForkExecuted: any reads
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>

#include "host/model/marked_time.h"
#include "urgengo/abi/device_mailbox.h"

namespace urgengo::model {

using std::chrono::nanoseconds;

class ForkProgress {
  public:
    static constexpr int kBranches = UG_MARK_BRANCHES;

    /// A launch was made that no mark vouches for.
    /// @param branch  its stream's (StreamGraph::branch())
    /// @param open    GPU time of all since the last mark that does vouch for all before it
    /// @param mark    that one
    void launched(int branch, nanoseconds estimate, nanoseconds open, std::uint32_t mark) {
        if (!is_there_ || mark != mark_) begin(mark, open - estimate);
        if (branch < 0 || branch >= kBranches) {
            is_followed_ = false;
            return;
        }
        at(branch).launched += estimate;
        last_ = estimate;
        total_ += estimate;
    }
    /// @returns whether there is any that is not known to be over
    bool is_there() const { return is_there_; }
    /// @param mark  the last one that was issued
    /// @returns whether the task is in a fork, or behind one without a mark, that is followed
    bool is_followed(std::uint32_t mark) const {
        return is_there_ && is_followed_ && mark == mark_;
    }
    /// Its branches get no marks.
    void is_not_marked() { is_followed_ = false; }

    /// @param every  from one mark to the next
    /// @returns whether so much is launched on the branch since its last mark
    bool mark_is_due(int branch, nanoseconds every) {
        Branch& its = at(branch);
        its.every = every;
        return its.launched - its.marked >= every;
    }
    /// @param mark  the last one that was issued
    /// @returns GPU time of the last launch in the fork; 0: the task is in none
    nanoseconds last(std::uint32_t mark) const {
        return is_followed(mark) ? last_ : nanoseconds{0};
    }
    /// What the branch's next mark is to write.
    std::uint64_t word(int branch) const {
        return static_cast<std::uint64_t>(at(branch).launched.count());
    }
    void marked(int branch) { at(branch).marked = at(branch).launched; }
    /// @returns whether a branch's mark is under way: without one, waiting tells no more
    bool is_marked(const ug_mark_line& line) const {
        for (int i = 0; i < kBranches; ++i) {
            const Branch& its = at(i);
            if (its.marked > its.base && seen(line, i) < its.marked) return true;
        }
        return false;
    }

    /// @param done  the last mark, of those that vouch for all, that was seen executed
    /// @returns GPU time, by launched, of what has executed since that one
    nanoseconds executed(const ug_mark_line& line, std::uint32_t done) const {
        if (!is_there_ || static_cast<std::int32_t>(done - mark_) > 0) return nanoseconds{0};
        nanoseconds told{0}, untold{0};
        for (int i = 0; i < kBranches; ++i) {
            const Branch& its = at(i);
            const nanoseconds last = std::clamp(seen(line, i), its.base, its.launched);
            told += last - its.base;
            untold += std::min(its.launched - last, its.every);
        }
        const nanoseconds before = done == mark_before_ ? before_ : nanoseconds{0};
        return told.count() == 0 ? before : before + trunk_ + told + untold;
    }
    /// A look was taken.
    /// @param executed  of it, by then
    /// @param paced     for how long the task has been paced, ever
    /// @param patience  for so long it may stand still meanwhile; then it is followed no more
    void looked(nanoseconds executed, nanoseconds paced, nanoseconds patience) {
        if (executed != looked_.executed || paced < looked_.paced)
            looked_ = {executed, paced};
        else if (paced - looked_.paced > patience)
            is_followed_ = false;
    }
    /// All that the task has launched is known to have executed, or nothing is known any more.
    void is_over() { is_there_ = false; }

  private:
    /// GPU time, ever
    struct Branch {
        nanoseconds launched{0}, marked{0};
        nanoseconds base{0};   ///< launched when the fork began
        nanoseconds every{0};  ///< what was launched without a mark is less
    };
    struct Looked {
        nanoseconds executed{-1}, paced{0};
    };
    Branch& at(int branch) { return branches_[static_cast<std::size_t>(branch)]; }
    const Branch& at(int branch) const { return branches_[static_cast<std::size_t>(branch)]; }
    static nanoseconds seen(const ug_mark_line& line, int branch) {
        return nanoseconds(
            static_cast<std::int64_t>(__atomic_load_n(&line.branch[branch][0], __ATOMIC_ACQUIRE)));
    }
    void begin(std::uint32_t mark, nanoseconds trunk) {
        before_ = is_there_ && is_followed_ ? trunk_ + total_ : nanoseconds{0};
        mark_before_ = mark_;
        mark_ = mark;
        trunk_ = trunk;
        total_ = nanoseconds{0};
        looked_ = {};
        is_there_ = is_followed_ = true;
        for (Branch& its : branches_) its.base = its.launched;
    }

    std::array<Branch, kBranches> branches_{};
    nanoseconds trunk_{0};  ///< of what is before the fork and behind the mark
    nanoseconds total_{0}, last_{0}, before_{0};
    Looked looked_;
    std::uint32_t mark_ = 0, mark_before_ = 0;
    bool is_there_ = false, is_followed_ = false;
};

/// What a look at it told, to 256 ns, for as long as no other mark is seen executed.
class ForkExecuted {
  public:
    void store(nanoseconds executed, std::uint32_t done) {
        word_.store(MarkedTime::word(executed, done), std::memory_order_relaxed);
    }
    void forget() { word_.store(0, std::memory_order_relaxed); }
    nanoseconds load(std::uint32_t done) const {
        const std::int64_t word = word_.load(std::memory_order_relaxed);
        return MarkedTime::is_of(word, done) ? MarkedTime::time(word) : nanoseconds{0};
    }

  private:
    std::atomic<std::int64_t> word_{0};
};

}  // namespace urgengo::model
