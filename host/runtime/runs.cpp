// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/runs.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "host/base/memory_orders.h"
#include "host/runtime/estimates.h"
#include "host/sched/instance_slot.h"
#include "host/sched/lending.h"

namespace urgengo::runtime {
namespace {

/// Below this confidence a task without hints is observed only. Three bad instances in a row do it.
constexpr double kMinConfidence = 0.7;

}  // namespace

// --- which thread has taken a task

bool Runs::take(TaskState& task, bool executed) {
    if (task.taking.busy.exchange(true)) return false;
    segments_.catch_up(task, executed);
    return true;
}

bool Runs::take(ThreadState& thread, TaskState& task, bool executed) {
    if (task.taking.busy.exchange(true)) return false;
    thread.at_task = &task;
    segments_.catch_up(task, executed);
    return true;
}

// Looked at while the task is taken: until then its run may be ended, and be another thread's.
bool Runs::take_own(ThreadState& thread, TaskState& task) {
    if (!take(thread, task)) return false;
    if (task.taking.owner.load(kRelaxed) == &thread) [[likely]]
        return true;
    release(thread);
    return false;
}

// The owner may have ended the run meanwhile, and found us at it. It says so before it tries to
// take the task, and we look after we have let go of it (both sequentially consistent): so one of
// the two finishes the run. If we looked first, it could find us still busy, and neither would.
void Runs::release(ThreadState& thread) {
    TaskState& task = *thread.at_task;
    thread.at_task = nullptr;
    let_go(task);
}

void Runs::let_go(TaskState& task) {
    task.taking.busy.store(false);
    if (task.taking.end_is_due.load() || task.taking.sync_end_is_due.load()) [[unlikely]]
        finish_due(task);
    if (task.taking.streams_are_gone.load(kRelaxed)) [[unlikely]]
        forget_streams(task);
}

// Called by the thread that lets go of the task: the stream may be of any thread.
void Runs::forget_streams(TaskState& task) {
    if (task.taking.busy.exchange(true)) return;  // the thread that is at it will
    segments_.catch_up(task);
    if (task.taking.streams_are_gone.exchange(false))
        task.streams.graph.forget_streams(num_launched(task));
    task.taking.busy.store(false);
    if (task.taking.end_is_due.load() || task.taking.sync_end_is_due.load()) finish_due(task);
}

// --- whose run it is

TaskState* Runs::own_task(ThreadState& thread) {
    if (thread.task && thread.task->taking.owner.load(kRelaxed) != &thread) [[unlikely]]
        thread.task = nullptr;
    return thread.task;
}

bool Runs::claim(ThreadState& thread, TaskState& task) {
    ThreadState* none = nullptr;
    if (!task.taking.owner.compare_exchange_strong(none, &thread, std::memory_order_acquire))
        return false;
    // A helper of the last run may have come too late, and be about to find that out.
    if (!take(thread, task)) {
        task.taking.owner.store(nullptr, std::memory_order_release);
        return false;
    }
    thread.task = &task;
    return true;
}

// The thread has claimed the task; it lets go of it here.
void Runs::begin(ThreadState& thread, TaskState& task, nanoseconds arrival, nanoseconds now,
                 bool hinted) {
    thread.serves.chains.serve(static_cast<int>(task.slot->chain.load(kRelaxed)), now);
    task.known_by.matched.store(true, kRelaxed);
    thread.line.ask_again();
    task.thread.has(thread.id);
    task.unasked.counted.store(task.slot->as_planned.load(kRelaxed), kRelaxed);
    std::construct_at(&task.run);  // in its place: it is six cache lines
    task.tracked = {};
    task.batches.waited_in_vain = false;
    task.streams.begin_run(num_launched(task));
    task.tracked.arrival = arrival;
    task.tracked.begin = now;
    task.slot->waits.store(0, kRelaxed);
    task.tracked.hinted = hinted;
    if (hinted) task.tracked.cpu_begin = now;  // without hints it begins with a launch
    const config::Mode mode = task.chain->mode();
    task.run.only_decides = mode == config::Mode::kShadow;
    const bool stands_aside = common_.governor.stands_aside(now);
    const bool only_observes = std::min(mode, common_.mode()) < config::Mode::kShadow ||
                               common_.guard.observes(task.chain->index);
    const bool is_unsure = !hinted && task.known_by.confidence < kMinConfidence;
    task.run.observed = only_observes || is_unsure || stands_aside;
    observe::FrameCounters& frames = task.its_chain().statistics.frames;
    if (stands_aside && task.stage == 0)
        frames.stood_aside.fetch_add(1, kRelaxed);
    else if (is_unsure && !only_observes && !stands_aside)
        frames.observed.fetch_add(1, kRelaxed);
    if (task.run.observed) common_.governor.company().unmarked_begins(now);
    task.is_unseen.store(task.run.observed, kRelaxed);
    if (task.run.observed || !hinted) task.chain->expectation.launched(arrival, now);
    task.tracker = model::InstanceTracker(task.plan);
    common_.observers.causes.run_begins(task, now);
    if (hinted) common_.observers.causes.cpu_segment_begins(task, now);
    if (common_.tracer.is_on()) {
        const int flags =
            (hinted ? abi::kTraceHinted : 0) | (task.run.observed ? abi::kTraceObserved : 0);
        common_.tracer.instance(thread, task, abi::TraceKind::kInstanceBegin, now, flags);
    }

    const nanoseconds served = task.chain->bandwidth.served(arrival);
    sched::begin_instance(common_.governor.tasks(), task,
                          served_deadline(thread, served + task.chain->deadline(), now),
                          still_to_launch(task), still_idle(task), now);
    common_.observers.records.task_begins(task, now);
    if (TaskState* const other = std::exchange(thread.waits.lends_to, nullptr);
        other && other != &task)
        lend_along(task, *other, thread.waits.lends_until);
    common_.observers.nvtx.run_begins(task, arrival, now);
    if (common_.governor.acts() && common_.enforces(task) && !task.run.observed)
        common_.nice.take(thread.nice);
    release(thread);
}

void Runs::observe_from_here(TaskState& task, nanoseconds now) {
    task.run.observed = true;
    common_.governor.company().unmarked_begins(now);
    task.is_unseen.store(true, kRelaxed);
    if (task.run.position == 0 && task.tracked.hinted)
        task.chain->expectation.launched(task.tracked.arrival, now);
}

void Runs::end_taken(TaskState& task) {
    if (task.taking.owner.load(kRelaxed) == nullptr) return;  // it was ended in its owner's place
    // Its next owner is about to take the task: it would find its run begun by no one.
    if (task.slot->state.load(kRelaxed) == abi::TaskState::kIdle) return;
    syncs_.leave(task);
    segments_.leave(task, false);
    const nanoseconds now = common_.clock.now();
    common_.observers.causes.run_ends(task, now);
    common_.observers.nvtx.run_ends(task, now);
    common_.observers.records.task_ended(task, now);
    if (task.run.observed) common_.governor.company().unmarked_ends();
    task.record.cpu.end_instance(0);
    task.estimated.cpu_ns.store(task.record.cpu.total().count(), kRelaxed);
    if (task.learning && !task.run.observed && task.run.position > 0) {
        model::Durations& durations = task.learning->durations();
        durations.end_instance(task.run.position);
        task.estimated.gpu_ns.store(durations.remaining_from(0).count(), kRelaxed);
    }
    instance_measured(common_, task);
    task.slot->state.store(abi::TaskState::kIdle, kRelaxed);
    common_.governor.queue().leaves(task.index);  // its thread may have ended, or jumped, in a hold
    common_.governor.tasks().set_active(task, false);
    task.taking.owner.store(nullptr, std::memory_order_release);
}

// One thread may serve several chains: what it holds up, it holds up for all of them.
nanoseconds Runs::served_deadline(ThreadState& thread, nanoseconds own, nanoseconds now) const {
    nanoseconds earliest = own;
    const auto chain_at = [&](int i) -> const ChainState& {
        return *common_.roster.chains()[static_cast<std::size_t>(i)];
    };
    const auto period_of = [&](int i) { return chain_at(i).longest(); };
    int num_served = 0;
    thread.serves.chains.for_each(now, period_of, [&](int i) {
        ++num_served;
        const ChainState& chain = chain_at(i);
        const nanoseconds last(chain_at(i).last_arrival_ns.load(kRelaxed));
        if (last.count() == 0) return;
        // Its last frame may still wait for this thread; if not, its next one will.
        const nanoseconds next = last + chain.period() + chain.deadline();
        if (next > now) earliest = std::min(earliest, next);
    });
    if (num_served <= 1) return own;
    return earliest;
}

void Runs::end(ThreadState& thread, TaskState& task) {
    thread.task = nullptr;
    thread.line.ask_again();  // which helper may still be at the task
    if (common_.tracer.is_on()) {
        const int flags = (task.tracked.hinted ? abi::kTraceHinted : 0) |
                          (task.tracker.fits() ? 0 : abi::kTraceResync);
        common_.tracer.instance(thread, task, abi::TraceKind::kInstanceEnd, common_.clock.now(),
                                flags);
    }
    task.taking.end_is_due.store(true);
    finish_due(task);
}

void Runs::sync_ended(TaskState& task) {
    task.taking.sync_end_is_due.store(true);
    finish_due(task);  // or the thread that is at the task does, when it lets go
}

// Another thread that is at the task does this when it lets go.
void Runs::finish_due(TaskState& task) {
    do {
        if (task.taking.busy.exchange(true)) return;
        segments_.catch_up(task);
        if (task.taking.sync_end_is_due.exchange(false)) syncs_.leave(task);
        if (task.taking.end_is_due.exchange(false)) end_taken(task);
        task.taking.busy.store(false);
        // Another end may have become due while we had the task.
    } while (task.taking.end_is_due.load() || task.taking.sync_end_is_due.load());
}

void Runs::end_abandoned(ThreadState& thread, TaskState& task, nanoseconds now) {
    if (!take(thread, task)) return;
    if (!task.tracked.hinted && now - task.tracked.begin > task.chain->abandoned_after()) {
        task.taking.end_is_due.store(true);
        common_.governor.tasks().changed();  // its owner launches nothing of it unasked any more
    }
    release(thread);
}

void Runs::end_all() {
    for (const auto& chain : common_.roster.chains()) end_all(*chain);
}

void Runs::end_all(const ChainState& chain) {
    for (const int index : chain.tasks) {
        TaskState* const task = &common_.roster.task(index);
        if (task->taking.owner.load() == nullptr) continue;
        // A flag at a task that is free could end the run after this one.
        if (take(*task)) {
            end_taken(*task);
            let_go(*task);
        } else {
            task->taking.end_is_due.store(true);
            finish_due(*task);
        }
    }
}

void Runs::lend_along(TaskState& task, TaskState& waited_for, nanoseconds until, bool holds_back) {
    if (!common_.enforces(task) || !common_.enforces(waited_for)) return;
    if (holds_back)
        task.awaited.add(waited_for.index, until,
                         nanoseconds(task.slot->launched_ns.load(kRelaxed)));
    FrameCauses::waits_for(task, waited_for);
    if (!sched::lend_along(common_.governor.tasks(), task, waited_for, until, common_.clock.now()))
        return;
    common_.governor.tasks().changed();
}

}  // namespace urgengo::runtime
