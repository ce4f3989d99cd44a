// SPDX-License-Identifier: Apache-2.0
//
// The standing plan: what the policy `feasible` has planned last, for all threads, and how long it
// stands.
//
// 1 A plan stands for 0.2 ms while no task comes to the GPU or leaves it, but not beyond the time
//   at which one that is in time would be late. Where a late instance goes is for the next plan to
//   say: until then it would come after all others, and what these launch meanwhile, a whole fork
//   perhaps, stays before it. (At least 20 us: an instance may be in time by a moment for long.)
// 2 A plan that took more than 20 us to make stands for five times as long as that, even if
//   tasks come or leave: of hundreds of tasks one always does. So does what is decided by it: until
//   another plan is due, asking again would find the same one.
// 3 One thread at a time makes a plan, in scratch that is the plan's: a program's stack may have
//   16 KiB, and a plan takes more. The others go by the last one meanwhile.
// 4 The maker is known by the task that it decides for, which no other thread has meanwhile. A
//   program may jump out of our frames (siglongjmp): the call that gives the task back releases the
//   plan, too.
// 5 That an instance is given up, or taken back, is a change (SharedPage::changes).
//
// @threads any
#pragma once

#include <atomic>
#include <optional>
#include <vector>

#include "host/config/config.h"
#include "host/sched/given_up.h"
#include "host/sched/policies/feasible.h"
#include "host/sched/tasks.h"

namespace urgengo::sched {

class StandingPlan {
  public:
    /// @param both  outlive it
    /// @param most  instances that there can be: one a task, and the next one of each chain
    StandingPlan(const config::Scheduler& scheduler, const Tasks& tasks, std::size_t most);

    struct Answer {
        Plan plan;
        bool was_made = false;  ///< just now: took() is due
    };
    /// @param[in,out] changes  SharedPage::changes to plan for; then, what the answer is good for
    /// @param maker  the caller's task
    Answer plan(nanoseconds now, std::uint32_t& changes, const GovernedTask& maker);
    /// Makes a plan, if the last one is old and no thread is making one. By a thread that has no
    /// task.
    void refresh(nanoseconds now);
    /// @returns whether the plan is one from before `changes`, and another may be made now
    bool is_due(std::uint32_t changes, nanoseconds now) const;
    /// @param cost  what making a plan took
    void took(nanoseconds cost);
    /// The task's thread is not at a plan any more, if it ever was.
    void release_if_by(const GovernedTask& maker);

    /// Load::launching_is_scarce, as of the last plan.
    bool launching_is_scarce() const { return launching_is_scarce_.load(kRelaxed); }

    bool gives_up(const GovernedTask& task) const { return given_up_.contains(task.index); }
    /// @returns why the task's instance was given up last, if it ever was
    GivenUp why_given_up(const GovernedTask& task) const;
    /// What all chains need, anew: what is known of a task has changed.
    void reckon_load();

  private:
    static constexpr auto kRelaxed = std::memory_order_relaxed;
    static constexpr int kNoMaker = -1, kRefresher = -2;

    Plan read() const {
        return {given_up_.load(),
                late_first_.load(),
                may_share_.load(),
                slack_.load(kRelaxed),
                has_to_share_.load(kRelaxed),
                launching_is_scarce_.load(kRelaxed)};
    }
    /// @returns nothing: the last plan stands, or another thread makes one
    std::optional<Plan> make_if_due(nanoseconds now, std::uint32_t& changes, int maker);
    /// @returns whether it stands even if tasks come or leave
    bool is_kept(nanoseconds now) const;
    Plan make(nanoseconds now, std::uint32_t& changes);
    void note_reasons();

    const config::Scheduler& scheduler_;
    const Tasks& tasks_;
    std::atomic<std::uint32_t> changes_{0};  ///< that it was made for
    std::atomic<nanoseconds> time_{nanoseconds{-1'000'000'000}};
    std::atomic<nanoseconds> until_{nanoseconds{-1'000'000'000}};  ///< it stands, if none comes
    model::SharedTaskSet given_up_, late_first_, may_share_;
    std::vector<std::atomic<std::uint64_t>> reasons_;  ///< by task: GivenUp, in one word
    std::atomic<nanoseconds> slack_{nanoseconds{0}};
    std::atomic<bool> has_to_share_{false}, launching_is_scarce_{false};
    std::atomic<nanoseconds> cost_{nanoseconds{0}};
    /// What all chains need, as reckon_load() found.
    struct {
        std::atomic<double> gpu{0}, shared{0}, launching{0};
    } load_;
    std::atomic<int> maker_{kNoMaker};
    // Of the thread that makes a plan:
    std::vector<SlotView> views_;
    PlanScratch scratch_;
};

}  // namespace urgengo::sched
