// SPDX-License-Identifier: Apache-2.0
//
// The Governor: all that decides, over the slots of the active kernel buffer and the tasks' records
// (governed.h). It is told what happens, and asked what may be done: a launch goes, or waits and is
// asked about again. It knows no CUDA, no clock, no thread and no lock; time is an argument.
//
//   goes_as_before(), else ask()  ->  goes: levels() say at which priority
//                                 ->  waits: sleeps(), the caller sleeps, slept(), ask(), looked()
//                                     (queue().leaves(), if it is not asked about again)
//
// One thread at a time is at a task: what is told or asked about that task, is by that thread. What
// is of all tasks are atomics of the part that they belong to; a race costs one decision of
// microseconds. Nothing is allocated after the tasks were added.
#pragma once

#include <atomic>
#include <optional>
#include <span>
#include <vector>

#include "host/config/config.h"
#include "host/sched/ahead.h"
#include "host/sched/bystanders.h"
#include "host/sched/company.h"
#include "host/sched/estimates.h"
#include "host/sched/lending.h"
#include "host/sched/poll_budget.h"
#include "host/sched/standing_aside.h"
#include "host/sched/standing_plan.h"
#include "host/sched/steered_mode.h"
#include "host/sched/tasks.h"
#include "host/sched/urgency_queue.h"
#include "host/sched/urgent_threshold.h"

namespace urgengo::sched {

/// What only the launching side knows of a launch.
struct Request {
    bool enforces = true;  ///< its chain may be held and paced: so says the guard
    bool is_seen = true;   ///< marks tell, or would, when all that was launched has executed
};

/// The launch sleeps, and is asked about again.
struct Wait {
    nanoseconds sleep{0};
    Why why = Why::kNone;
    int behind = -1;          ///< task: of those that it waits for, the first in order; -1: none
    Key key = 0;              ///< its place in the urgency queue
    bool is_paced = false;    ///< waits for its own work on the GPU alone; else it is held
    bool wants_mark = false;  ///< what was launched is to be seen meanwhile: a mark is due
    bool has_work = false;    ///< of the task, on the GPU
};

struct Answer {
    Decision decision;  ///< whatever it says of going: see `wait`
    std::optional<Wait> wait{};
    Loan loan = Loan::kNone;
    bool has_made_plan = false;  ///< plan().took() is due
};

class Governor {
  public:
    /// @param page, listener  outlive it
    /// @param start  now
    Governor(const config::Scheduler& scheduler, const std::vector<config::Chain>& chains,
             config::Mode mode, abi::SharedPage& page, ProgressListener& listener,
             nanoseconds start);

    // --- told
    /// The task has made its first launch of a segment, or will at once.
    void comes_to_gpu(const GovernedTask& task, nanoseconds now);
    /// Its segment is over, or no mark can show any more how far it is.
    void leaves_gpu(GovernedTask& task, nanoseconds now);
    /// Due at every look at others: once a window it tells whether a bystander is busy.
    void look_for_bystanders(nanoseconds now);
    /// A launch of the task is about to sleep, as it was answered: it stands in the urgency queue
    /// until it is let go, or is given up.
    void sleeps(GovernedTask& task, const Wait& wait);
    /// It has slept for so long.
    void slept(GovernedTask& task, const Wait& wait, nanoseconds time, nanoseconds now);
    /// It has been asked about again, which took from `begin` to `end`: the next sleep is reckoned
    /// anew.
    void looked(const GovernedTask& task, Answer& answer, nanoseconds begin, nanoseconds end);

    // --- asked
    /// @returns whether an instance that begins now is observed only (standing_aside.h)
    bool stands_aside(nanoseconds now);
    /// @returns what was decided of the last launches, if that stands for this one
    std::optional<Decision> goes_as_before(GovernedTask& task, nanoseconds now);
    /// Of a launch, or of one that has slept.
    Answer ask(GovernedTask& task, const Request& request, nanoseconds now);
    /// A mark of the task is due. @returns whether it is not worth its launch: the task has looked
    bool looks_instead_of_mark(GovernedTask& task, nanoseconds now);
    /// Of a launch that goes. @param is_vouched  marks show how far the task is
    Levels levels(GovernedTask& task, bool is_vouched, const Decision& decision, nanoseconds now);
    /// @param at_engine  tasks with copies there, by index
    /// @returns whether a copy of the task waits for one of those. Its views are used.
    bool copy_waits(GovernedTask& task, std::span<const bool> at_engine, Answer& answer,
                    nanoseconds now);
    /// The first task stays first until a task comes to the GPU or leaves it, or an instance is
    /// given up or taken back; at least under the policies whose keys do not change meanwhile.
    bool decision_stands(const GovernedTask& task, nanoseconds now) const;
    bool decision_is_remembered(const GovernedTask& task, double utilization, nanoseconds time,
                                nanoseconds now) const;
    bool goes_without_a_look(const GovernedTask& task, nanoseconds now) const;
    /// @returns for how long an instance may be held, and paced, in all
    nanoseconds hold_bound(const GovernedTask& task) const;
    /// @returns whether there is scheduling at all: by the mode and the config
    bool schedules() const;
    /// @returns whether there are holds, priorities and gates
    bool acts() const { return schedules() && !steered_.only_decides(); }
    SteeredMode& steered() { return steered_; }
    const SteeredMode& steered() const { return steered_; }

    Tasks& tasks() { return tasks_; }
    const Tasks& tasks() const { return tasks_; }
    Company& company() { return company_; }
    const Company& company() const { return company_; }
    const Ahead& ahead() const { return ahead_; }
    StandingPlan& plan() { return plan_; }
    const StandingPlan& plan() const { return plan_; }
    Estimates& estimates() { return estimates_; }
    const StandingAside& aside() const { return aside_; }
    Bystanders& bystanders() { return bystanders_; }
    const Bystanders& bystanders() const { return bystanders_; }
    PollBudget& polls() { return polls_; }
    UrgencyQueue& queue() { return queue_; }

  private:
    Decision decide(GovernedTask& task, const SlotView& self, bool enforces, Answer& answer,
                    nanoseconds now);
    void look_at_fork(GovernedTask& task) const;
    /// @returns whether a mark is under way that tells how far the task is in its fork
    static bool fork_tells(const GovernedTask& task);
    /// @returns whether its own run-ahead allows the launch
    bool look(GovernedTask& task, const Request& request, Answer& answer, bool& is_marked,
              bool& has_work, nanoseconds now);
    void lend(GovernedTask& task, const SlotView& self, Answer& answer, bool& within,
              nanoseconds now);
    void record_urgency(nanoseconds now);
    nanoseconds rest(const GovernedTask& task, const Answer& answer) const;
    int num_levels(const GovernedTask& task) const;
    /// A bystander is busy, and the launch at hand is held all the same: what was decided of others
    /// says nothing of this one.
    bool is_long_beside_bystander(const GovernedTask& task) const {
        return bystanders_.are_busy() && !bystanders_.are_busy(next_kernel(task));
    }
    /// Of the launch at hand: a graph is many.
    static nanoseconds next_kernel(const GovernedTask& task) {
        return nanoseconds(static_cast<std::int64_t>(static_cast<double>(task.run.next.count()) /
                                                     task.plan.kernels_of_launch()));
    }
    /// The settings by which the task's next launch is decided, now.
    const config::Scheduler& scheduler_now(const GovernedTask& task, const SlotView& self) const {
        if (!bystanders_.are_busy()) return scheduler_;
        return bystanders_.are_busy(next_kernel(task), self.remaining.gpu, self.laxity)
                   ? priorities_alone_
                   : scheduler_;
    }

    const config::Scheduler scheduler_;
    const config::Scheduler priorities_alone_;  ///< the same, without holds
    const bool follows_urgencies_;              ///< TH_urgent is wanted
    const bool keys_stand_;  ///< the policy's keys do not change with time or progress
    abi::SharedPage& page_;
    SteeredMode steered_;
    Tasks tasks_;
    Company company_;
    Ahead ahead_;
    StandingPlan plan_;
    StandingAside aside_;
    UrgentThreshold urgent_threshold_;
    Bystanders bystanders_;
    Estimates estimates_;
    UrgencyQueue queue_;
    PollBudget polls_;  ///< of held launches
};

}  // namespace urgengo::sched
