// SPDX-License-Identifier: Apache-2.0
//
// The program's waits: what each is for, and whether it ends its task's GPU segment.
#include "host/runtime/waits.h"

#include <algorithm>
#include <utility>

#include "host/base/memory_orders.h"
#include "host/identity/stream_id.h"
#include "host/observe/wait_name.h"
#include "host/sched/instance_slot.h"

namespace urgengo::runtime {
namespace {

bool names_stream(abi::TraceWait function) {
    return function == abi::TraceWait::kStream || function == abi::TraceWait::kCopy ||
           function == abi::TraceWait::kStreamQuery;
}

bool is_query(const Wait& wait) {
    return wait.function == abi::TraceWait::kStreamQuery ||
           wait.function == abi::TraceWait::kEventQuery;
}

// Does this call wait for all that the thread has launched?
bool waits_for_all(const ThreadState& thread, const Wait& wait) {
    if (wait.function == abi::TraceWait::kContext) return true;
    if (names_stream(wait.function))
        return thread.line.stream == wait.stream &&
               (wait.stream || thread.line.flavor == wait.flavor);
    return std::any_of(thread.waits.events.begin(), thread.waits.events.end(), [&](const auto& e) {
        return e.event == wait.event && e.event && e.launches == thread.line.launches;
    });
}

}  // namespace

Waits::Waits(Common& common, const Around& around, bool sleep)
    : common_(common),
      around_(around),
      cheap_(sleep, common.driver, common.clock, common.streams.captures(), common.governor) {}

void Waits::before(ThreadState& thread, Wait& wait) {
    if (common_.tracer.is_on()) [[unlikely]]
        wait.begin = common_.clock.now();
    TaskState* task = Runs::own_task(thread);
    const bool by_last = waits_for_all(thread, wait);
    const auto by_streams = around_.streams.covers_all(thread, wait, by_last);
    if (!task && !common_.tracer.is_on()) return;
    if (task && !common_.tracer.is_on()) wait.begin = common_.clock.now();
    if (task) task->slot->waits.store(1, kRelaxed);
    if (task && !is_query(wait)) common_.observers.records.wait_begins(*task, wait.begin);
    wait.for_all = by_streams.value_or(by_last);
    // On the legacy stream a mark is a barrier for what other threads have launched since; a query
    // is over before a mark could tell anything.
    const bool markable =
        wait.function == abi::TraceWait::kStream || wait.function == abi::TraceWait::kCopy;
    if (!task || !wait.for_all || !markable || identity::is_legacy(wait.stream, wait.flavor))
        return;
    // A task that arrives meanwhile learns of this one's end when the wait returns.
    if ((common_.governor.company().is_alone() && !common_.scheduler.progress.learn) ||
        !common_.follows_marks())
        return;
    mark_before(thread, *task, wait, by_streams.has_value());
}

void Waits::mark_before(ThreadState& thread, TaskState& task, const Wait& wait, bool by_streams) {
    if (!around_.runs.take(thread, task)) return;
    sched::GovernedRun& run = task.run;
    TrackedRun& tracked = task.tracked;
    if (run.on_gpu && task.work.launched != task.work.marked &&
        (by_streams || tracked.stream == wait.stream)) {
        // What it waits for is all; on the stream that it names that is vouched for.
        const auto stream = std::exchange(tracked.stream, wait.stream);
        const auto flavor = std::exchange(tracked.flavor, wait.flavor);
        around_.segments.emit_mark(task, common_.clock.now(), GpuSegments::Place::kAtEnd);
        tracked.stream = stream;
        tracked.flavor = flavor;
    }
    around_.runs.release(thread);
}

void Waits::after(ThreadState& thread, const Wait& wait, bool succeeded) {
    const bool has_launched = std::exchange(thread.serves.name_is_fresh, false);
    bool for_all = wait.for_all && succeeded;
    if (TaskState* const waited = std::exchange(thread.waits.waited_for.task, nullptr);
        waited && succeeded) [[unlikely]]
        for_all &= around_.streams.covered_has_executed(thread, *waited);
    if (common_.tracer.is_on()) [[unlikely]]
        common_.tracer.waited(thread, wait, for_all);
    if (thread.copied.task && succeeded) [[unlikely]]
        Copies::waited_for(thread, wait);
    TaskState* task = Runs::own_task(thread);
    const nanoseconds now = common_.clock.now();
    if (task) task->slot->waits.store(0, kRelaxed);
    if (task && !is_query(wait)) common_.observers.records.wait_ended(*task, wait.begin, now);
    if (task && for_all && around_.runs.take(thread, *task, true)) {
        // A wait for a copy is not one for kernels alone, and a query that says that all is done
        // does not say when the program began to wait for that.
        const bool tells = wait.function != abi::TraceWait::kCopy && !is_query(wait);
        if (tells) task->run.wait_begin = wait.begin;
        thread.line.ask_again();
        if (wait.function == abi::TraceWait::kContext) task->streams.closing.all_covered();
        around_.segments.leave(*task, true);
        const bool at_end = task->tracker.closed(observe::wait_name(wait.function));
        const bool ends_run = at_end && !thread.serves.hinted && !thread.serves.ranged;
        if (!ends_run) {
            task->tracked.cpu_begin = now;
            common_.observers.causes.cpu_segment_begins(*task, now);
            sched::begin_segment(common_.governor.tasks(), *task, task->tracker.segment(),
                                 task->tracked.cpu_begin);
        }
        around_.runs.release(thread);
        if (ends_run) around_.frames.end(thread, now, task->tracker.fits());
    } else if (task && sched::may_be_on_gpu(*task)) {
        task->run.window.begin += now - wait.begin;  // no launch was slowed down meanwhile
        task->run.pace.no_gap();
        // It was about to launch nothing, and is again.
        common_.governor.tasks().changed();
    }
    if (!task && !has_launched) around_.resolver.let_pass_if_bystander(thread);
    // For the arrival of what comes next. Threads that give hints tell it themselves.
    if (thread.serves.named.num_candidates > 0 && !thread.serves.uses_hints)
        thread.waits.last_wait.ended(now);
}

void Waits::wait_is_left(ThreadState& thread) {
    TaskState* const task = Runs::own_task(thread);
    if (!task) return;
    task->slot->waits.store(0, kRelaxed);
    if (sched::may_be_on_gpu(*task)) common_.governor.tasks().changed();
}

void Waits::sleep_through(ThreadState& thread, const Wait& wait) const {
    if (!cheap_.are_on()) return;
    if (!thread.task && thread.serves.named.num_candidates == 0) return;  // of no chain
    if (thread.task && thread.task->chain->mode() == config::Mode::kShadow) return;
    if (wait.function == abi::TraceWait::kContext) return;  // there is no question for it
    cheap_.sleep_until_over({wait.stream, wait.flavor, wait.event},
                            wait.for_all ? thread.task : nullptr);
}

void Waits::event_recorded(ThreadState& thread, CUevent event, CUstream stream,
                           exec::StreamFlavor flavor, bool timed) {
    thread.measuring = timed;
    if (timed) thread.line.ask_again();
    if (common_.streams.is_capturing(stream, flavor)) return;  // it is the graph's
    around_.streams.recorded(thread, event, stream, flavor);
    if (!thread.task && !common_.tracer.is_on())
        return around_.resolver.let_pass_if_bystander(thread);
    auto entry = std::find_if(thread.waits.events.begin(), thread.waits.events.end(),
                              [&](const auto& e) { return e.event == event; });
    if (thread.line.stream == stream && (stream || thread.line.flavor == flavor)) {
        if (entry == thread.waits.events.end()) {  // the oldest makes room
            std::rotate(thread.waits.events.begin(), thread.waits.events.begin() + 1,
                        thread.waits.events.end());
            entry = thread.waits.events.end() - 1;
        }
        *entry = {event, thread.line.launches};
    } else if (entry != thread.waits.events.end()) {
        *entry = {};
    }
}

void Waits::implicit_sync_begins(ThreadState& thread) {
    TaskState* task = Runs::own_task(thread);
    if (!task || !common_.governor.schedules() || common_.page().on_gpu.load(kRelaxed) == 0) return;
    if (!around_.runs.take(thread, *task)) return;
    around_.syncs.enter(*task);
    around_.runs.release(thread);
}

void Waits::implicit_sync_ended(ThreadState& thread) {
    if (TaskState* task = Runs::own_task(thread)) around_.runs.sync_ended(*task);
}

}  // namespace urgengo::runtime
