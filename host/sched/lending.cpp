// SPDX-License-Identifier: Apache-2.0
#include "host/sched/lending.h"

#include <algorithm>
#include <array>

#include "host/base/memory_orders.h"
#include "host/model/lent_deadline.h"
#include "host/sched/absence.h"
#include "host/sched/criticality.h"

namespace urgengo::sched {
namespace {

/// Tasks along a row of waits, the nearest first.
constexpr std::size_t kLongestRow = 8;

/// Whether what the asker launches may be what an awaited thread waits for.
enum class Helps { kNo, kPerhaps, kYes };

/// The task that asks for a loan.
struct Asker {
    const GovernedTask& task;
    nanoseconds deadline;  ///< a task with an earlier one is more urgent
    nanoseconds now;
    nanoseconds later;               ///< so much later than others this one is let go
    Helps enough = Helps::kPerhaps;  ///< it goes for no less
};

bool is_lent_by(const std::optional<Awaited>& awaited, const Asker& asker) {
    return awaited && !awaited->rests && is_lent(*awaited, asker.deadline, asker.now - asker.later);
}

/// The tasks that a thread has.
struct ItsTasks {
    GovernedTask* one = nullptr;            ///< null: it has none
    GovernedTask* waits_for_gpu = nullptr;  ///< in a call for that one's work
};

ItsTasks tasks_of(const Tasks& tasks, int thread) {
    ItsTasks its;
    for (GovernedTask* task : tasks.all()) {
        if (task->thread.id() != thread) continue;
        its.one = task;
        if (task->slot->waits.load(kRelaxed) != 0) its.waits_for_gpu = task;
    }
    return its;
}

// Whose work it is, is believed to need the GPU for as long as what the others have there lasts.
void make_room_for(const Tasks& tasks, GovernedTask& task, const SlotView& view, nanoseconds now) {
    nanoseconds before{0};
    tasks.for_each_active([&](GovernedTask& other) {
        if (&other != &task) before += tasks.look(other, now).ahead.launched;
    });
    const nanoseconds patience = view.ahead.waited + view.ahead.patience;
    const std::int64_t clear_ns = (now + patience + 2 * before).count();
    std::atomic<std::int64_t>& until_ns = task.slot->cleared_until_ns;
    std::int64_t last_ns = until_ns.load(kRelaxed);
    while (last_ns < clear_ns && !until_ns.compare_exchange_weak(last_ns, clear_ns, kRelaxed)) {
    }
}

/// @returns whether that changed anything: a task that is lent this deadline may have it for longer
bool lend(const Tasks& tasks, const model::LentDeadline& loan, GovernedTask& to, nanoseconds now) {
    const SlotView view = tasks.look(to, now);
    const bool is_sooner =
        loan.deadline < view.deadline || (loan.deadline == view.deadline && view.state.is_lent);
    if (!view.state.active || !is_sooner || !model::lend_deadline(*to.slot, loan, to.executed()))
        return false;
    make_room_for(tasks, to, view, now);
    return true;
}

/// The owner's thread has a mutex that the lender's waits for, and waits for the GPU itself: what
/// it has there is as urgent. (Not what it has yet to launch: the lender, once it has the mutex,
/// would come behind all of that.) The lender may have no instance yet: its slot tells no deadline.
void lend_for_mutex(const Tasks& tasks, const GovernedTask& lender, nanoseconds deadline,
                    GovernedTask& owner, nanoseconds now) {
    const nanoseconds launched(owner.slot->launched_ns.load(kRelaxed));
    const auto rank = static_cast<int>(lender.slot->static_rank.load(kRelaxed));
    if (lend(tasks, {deadline, launched, criticality(*lender.chain), rank}, owner, now))
        tasks.changed();
}

/// @param task     whose thread does not come
/// @param is_early  only a wait for a mutex counts
/// @returns kYes: it waits for a mutex of the asker's thread, or of one that waits for that one's,
///          and so on; kNo: for one of a thread that goes on by itself, or it does so itself
Helps helps_thread(const Tasks& tasks, const Asker& asker, const Awaited& awaited,
                   GovernedTask& task, bool is_early) {
    const int own = asker.task.thread.id();
    if (task.thread.id() == own) return Helps::kPerhaps;  // it is to come when it goes on
    ThreadWait wait = is_early ? task.thread.wait_early(asker.now) : task.thread.wait(asker.now);
    // Of a pool another thread may be the one that comes next.
    const bool is_to_begin = state_of(task) == abi::TaskState::kIdle;
    if (wait.what == ThreadWait::For::kMutex && is_to_begin && !task.thread.is_usual())
        return Helps::kPerhaps;
    for (std::size_t i = 0; i < kLongestRow; ++i) {
        if (wait.what == ThreadWait::For::kNothing) return Helps::kNo;
        if (wait.what != ThreadWait::For::kMutex) return Helps::kPerhaps;
        const ItsTasks its = tasks_of(tasks, wait.owner);
        if (its.waits_for_gpu)
            lend_for_mutex(tasks, task, awaited.deadline, *its.waits_for_gpu, asker.now);
        if (wait.owner == own) return Helps::kYes;
        // A thread of no chain may wait for anything, and so may one that waits for the GPU.
        if (!its.one || its.waits_for_gpu) return Helps::kPerhaps;
        wait = its.one->thread.wait(asker.now);
    }
    return Helps::kPerhaps;
}

/// @returns whether the launch goes for it, whose next one the task's thread is to make
Helps helps_awaited(const Tasks& tasks, const std::optional<Awaited>& awaited, GovernedTask& task,
                    const Asker& asker) {
    if (!awaited) return Helps::kNo;
    Awaited known = *awaited;
    known.since -= awaited->patience;
    known.rests = false;
    Asker at_once = asker;
    at_once.later = nanoseconds{0};
    if (!is_lent_by(known, at_once)) return Helps::kNo;
    const Helps its = helps_thread(tasks, asker, *awaited, task, !is_lent_by(awaited, asker));
    if (its == Helps::kYes) return its;
    Asker patient = asker;
    if (its == Helps::kNo) patient.later += kByItselfLater;
    return is_lent_by(awaited, patient) ? Helps::kPerhaps : Helps::kNo;
}

Helps helps_absent(const Tasks& tasks, const GovernedChain& chain, const Asker& asker) {
    GovernedTask& first = tasks[chain.tasks.front()];
    if (state_of(first) != abi::TaskState::kIdle) return Helps::kNo;
    const nanoseconds cpu(first.estimated.cpu_ns.load(kRelaxed));
    return helps_awaited(tasks, chain.expectation.awaited(chain.period(), chain.deadline(), cpu),
                         first, asker);
}

Helps helps_stalled(const Tasks& tasks, GovernedTask& task, const Asker& asker) {
    // A task that waits for the GPU waits for no lock, even if its work there cannot be seen.
    if (state_of(task) == abi::TaskState::kIdle || task.slot->waits.load(kRelaxed) != 0 ||
        task.is_unseen.load(kRelaxed))
        return Helps::kNo;
    return helps_awaited(
        tasks, stalled(*task.slot, tasks.look(task, asker.now), task.record.cpu_jitter.seen()),
        task, asker);
}

/// @returns whether it helps a more urgent task that is awaited, perhaps for a lock that the
///          asker's thread has: what is found first that is enough, else the most that is found
Helps helps_more_urgent(const Tasks& tasks, const Asker& asker) {
    Helps most = Helps::kNo;
    const auto is_enough = [&](Helps its) {
        most = std::max(most, its);
        return its >= asker.enough;
    };
    for (GovernedChain* chain : tasks.chains()) {
        if (chain == asker.task.chain || chain->mode() < config::Mode::kShadow) continue;
        if (is_enough(helps_absent(tasks, *chain, asker))) {
            // What is known need not prove itself.
            if (most == Helps::kPerhaps) chain->expectation.lend(asker.now);
            return most;
        }
        for (const int index : chain->tasks)
            if (is_enough(helps_stalled(tasks, tasks[index], asker))) return most;
    }
    return most;
}

nanoseconds deadline_of_held(const GovernedTask& task, bool is_given_up, nanoseconds now) {
    const abi::TaskSlot& slot = *task.slot;
    const nanoseconds own(slot.deadline_ns.load(kRelaxed));
    const bool is_last =
        now + model::corrected(slot, nanoseconds(slot.head_remaining_ns.load(kRelaxed))) > own ||
        is_given_up;
    return is_last ? nanoseconds::max() : own;
}

}  // namespace

Loan lend_urgency(const config::Scheduler& scheduler, const Tasks& tasks, const GovernedTask& task,
                  bool admit, int rank, Reach reach, bool is_given_up, nanoseconds now) {
    if (scheduler.admission != config::Admission::kPacked) return Loan::kNone;
    const nanoseconds later = admit ? kPacedLater : nanoseconds{0};
    const bool is_first = rank == 0, is_far = reach != Reach::kWithinLead;
    Asker asker{task, deadline_of_held(task, is_given_up, now), now, later};
    if (is_first && is_far) asker.enough = Helps::kYes;
    if (const Helps its = helps_more_urgent(tasks, asker); its != Helps::kNo) {
        if (!is_first) return Loan::kToHeld;
        if (!is_far) return Loan::kToFirst;
        return its == Helps::kYes && reach == Reach::kBeyondLead ? Loan::kToLead : Loan::kNone;
    }
    if (!admit || reach == Reach::kTooFar) return Loan::kNone;
    if (helps_more_urgent(tasks, {task, nanoseconds::max(), now, later}) == Helps::kNo)
        return Loan::kNone;
    return is_far ? Loan::kToLead : Loan::kToPaced;
}

bool lend_along(const Tasks& tasks, GovernedTask& task, GovernedTask& waited_for, nanoseconds until,
                nanoseconds now) {
    const SlotView self = tasks.look(task, now);
    if (!self.state.active) return false;
    struct Lent {
        GovernedTask* task;
        nanoseconds until;
    };
    std::array<Lent, kLongestRow> row{{{&waited_for, until}}};
    std::size_t length = 1;
    bool has_lent = false;
    // And to what that work is behind itself. In a circle of waits a loan changes nothing any more.
    for (std::size_t i = 0; i < length; ++i) {
        const Lent its = row[i];
        const model::LentDeadline loan{self.deadline, its.until, self.chain.criticality,
                                       self.chain.static_rank};
        if (!lend(tasks, loan, *its.task, now)) continue;
        has_lent = true;
        its.task->awaited.for_each_before(its.until, [&](int index, nanoseconds work) {
            if (length == kLongestRow || index == task.index) return;
            GovernedTask& behind = tasks[index];
            const nanoseconds launched(behind.slot->launched_ns.load(kRelaxed));
            row[length++] = {&behind, std::min(work, launched)};
        });
    }
    return has_lent;
}

}  // namespace urgengo::sched
