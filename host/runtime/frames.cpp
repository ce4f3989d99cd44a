// SPDX-License-Identifier: Apache-2.0
//
// Instances: their begins and ends, told by hints or by what the threads do.
//
// Without hints: an instance of a task begins with a launch and ends with a wait (which ones says
// model/instance_tracker). It has arrived as long before its first call as the thread has computed
// since its last wait (sched/backlog.h). Through the chain the instance is handed on in order:
// what a later task works on is the oldest that the task before it has finished
// (identity/instances.h).
#include "host/runtime/frames.h"

#include <optional>

#include "host/base/memory_orders.h"
#include "host/model/arrival_stamp.h"
#include "host/sched/instance_slot.h"

namespace urgengo::runtime {
namespace {

/// An instance that did not go as planned counts for an eighth of the task's confidence.
constexpr double kConfidenceStep = 1.0 / 8;

}  // namespace

Frames::Frames(Common& common, Runs& runs)
    : common_(common),
      runs_(runs),
      status_(common),
      instances_([this](const ChainState& chain) { dropped(chain); }) {
    for (const auto& chain : common_.roster.chains()) instances_.add_chain(*chain);
}

// --- hints

std::uint64_t Frames::arrival(ThreadState* thread, const char* chain_name, nanoseconds when) {
    ChainState* const chain = common_.roster.find_chain(chain_name);
    if (!chain || chain->is_switched_off() || common_.mode() == config::Mode::kOff) return 0;
    const nanoseconds now = common_.clock.now();
    if (!model::is_plausible(when, now, chain->period(), chain->abandoned_after())) {
        chain->statistics.frames.implausible.fetch_add(1, kRelaxed);
        when = now;
    }
    const std::uint64_t token = instances_.arrived(chain->index, when);
    enter(*chain, when, now);
    if (common_.tracer.is_on() && thread)
        common_.tracer.hint(*thread, abi::TraceKind::kArrival, static_cast<int>(chain->index),
                            token, when);
    return token;
}

bool Frames::task_begin(ThreadState& thread, std::uint64_t token, const char* task_name) {
    task_end(thread);
    leave_task(thread);
    const Instance instance = instances_.find(token);
    if (instance.token == 0) return false;
    TaskState* const task = common_.roster.find_task(*instance.chain, task_name);
    if (!task) return false;

    if (instance.chain->is_switched_off()) {
        instances_.forget(token);
        thread.serves.uses_hints = true;  // what it launches is of no chain
        return false;
    }
    const nanoseconds now = common_.clock.now();
    const nanoseconds short_by =
        sched::sure_lateness(common_.governor.tasks(), *task, instance.arrival, now);
    if (short_by.count() > 0 && instance.chain->on_late() == config::OnLate::kExit &&
        instance.chain->mode() == config::Mode::kEnforce &&
        !common_.guard.observes(instance.chain->index) && common_.governor.steered().enforces()) {
        end_early(*instance.chain, instance.arrival, short_by, now);
        tell_guard(*instance.chain, sched::kExitedDeadlines * instance.chain->deadline(), now);
        instances_.forget(token);
        return true;
    }
    // From here on the thread's launches are this task's, or of no chain if another thread has it.
    thread.serves.uses_hints = thread.serves.hinted = true;
    thread.line.passes = false;
    thread.serves.instance = instance;
    thread.serves.last_task = task->index == instance.chain->tasks.back();
    if (common_.tracer.is_on())
        common_.tracer.hint(thread, abi::TraceKind::kTaskBegin, task->index, token,
                            instance.arrival);
    if (runs_.claim(thread, *task)) runs_.begin(thread, *task, instance.arrival, now, true);
    return false;
}

void Frames::task_end(ThreadState& thread) {
    if (!thread.serves.hinted) return;
    if (common_.tracer.is_on())
        common_.tracer.hint(thread, abi::TraceKind::kTaskEnd, thread.task ? thread.task->index : -1,
                            thread.serves.instance.token, nanoseconds{0});
    leave_task(thread);
    if (!thread.serves.last_task) return;
    finish(*thread.serves.instance.chain, thread.serves.instance.arrival, common_.clock.now());
    instances_.forget(thread.serves.instance.token);
}

void Frames::leave_task(ThreadState& thread) {
    thread.serves.hinted = false;
    thread.serves.name_is_fresh = false;
    if (Runs::own_task(thread)) runs_.end(thread, *thread.task);
}

void Frames::finish(ChainState& chain, nanoseconds arrival, nanoseconds now) {
    chain.finished(arrival, now);
    tell_end(chain, arrival, now);
    tell_guard(chain, now - arrival, now);
}

void Frames::end_early(ChainState& chain, nanoseconds arrival, nanoseconds short_by,
                       nanoseconds now) {
    chain.exited(arrival, now);
    tell_end(chain, arrival, now, short_by);
}

void Frames::tell_end(const ChainState& chain, nanoseconds arrival, nanoseconds now,
                      std::optional<nanoseconds> exited_short_by) {
    Observers& observers = common_.observers;
    const bool exited = exited_short_by.has_value();
    const observe::Cause cause = observers.causes.frame_ended(chain, arrival, now, exited_short_by);
    observers.nvtx.frame_ended(chain, arrival, now, cause, exited);
    observers.records.frame_ended(chain, arrival, cause, exited, now);
    status_.ended(chain, now - arrival, cause, now);
}

void Frames::dropped(const ChainState& chain) {
    common_.observers.causes.dropped(chain);
    common_.observers.nvtx.dropped(chain);
    status_.dropped(chain);
    common_.observers.records.frame_dropped(chain, common_.clock.now());
}

void Frames::enter(ChainState& chain, nanoseconds arrival, nanoseconds now) {
    chain.entered(arrival, common_.governor.queue().waited_at());
    status_.arrived(chain);
    common_.observers.records.frame_begins(chain, arrival, now);
    if (common_.governor.steered().enforces() && !common_.governor.aside().is_on())
        common_.guard.frame_began(chain.index, arrival);
}

void Frames::tell_guard(const ChainState& chain, nanoseconds latency, nanoseconds now) {
    if (!common_.governor.steered().enforces()) return;
    // Of frames that are let alone the guard is not told: it would take them for scheduled ones.
    if (common_.governor.aside().is_on()) return common_.guard.pause();
    const LiveGuard::Surroundings surroundings{
        .beside_bystander = common_.governor.bystanders().are_busy(),
        .nobody_is_held = common_.governor.plan().launching_is_scarce()};
    if (!common_.guard.frame_ended(chain.index, latency, surroundings, now)) return;
    common_.governor.tasks().changed();
}

// --- without hints

/// @returns when the frame has arrived that the thread begins with
nanoseconds Frames::enter_chain(ThreadState& thread, TaskState& task, nanoseconds now) {
    ChainState& chain = task.its_chain();
    identity::LastWait& wait = thread.waits.last_wait;
    const nanoseconds computed = wait.computed(chain, now);
    const bool is_passed_on = chain.tasks.size() > 1;  // else no task follows
    if (is_passed_on) {
        const auto slept_since =
            wait.has_slept(computed, now) ? std::optional(wait.end()) : std::nullopt;
        if (const auto arrival = instances_.taken_over(chain.index, task.stage, slept_since))
            return *arrival;
    }
    const nanoseconds arrival = wait.begin_frame(chain, computed, now);
    enter(chain, arrival, now);
    if (is_passed_on) instances_.entered(chain.index, task.stage, arrival);
    return arrival;
}

bool Frames::begin(ThreadState& thread, TaskState& task, nanoseconds now) {
    if (task.chain->config.arrival == config::ArrivalFrom::kHint || task.chain->is_switched_off())
        return false;
    if (task.taking.owner.load(kRelaxed) != nullptr) runs_.end_abandoned(thread, task, now);
    if (!runs_.claim(thread, task)) return false;
    runs_.begin(thread, task, enter_chain(thread, task, now), now, false);
    thread.serves.named.last = task.index;
    return true;
}

void Frames::end(ThreadState& thread, nanoseconds now, bool as_planned) {
    TaskState& task = *thread.task;
    const nanoseconds arrival = task.tracked.arrival;
    if (!as_planned) task.its_chain().statistics.frames.resyncs.fetch_add(1, kRelaxed);
    task.known_by.confidence +=
        kConfidenceStep * ((as_planned ? 1.0 : 0.0) - task.known_by.confidence);
    runs_.end(thread, task);
    if (task.chain->tasks.size() > 1)
        instances_.handed_on(task.chain->index, task.stage, arrival, now);
    if (task.index == task.chain->tasks.back()) finish(task.its_chain(), arrival, now);
}

}  // namespace urgengo::runtime
