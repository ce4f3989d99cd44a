// SPDX-License-Identifier: Apache-2.0
//
// A task over several streams: which wait is one for all that it has launched, and where a mark
// vouches for all (progress/stream_graph.h). A task that stays on one stream is not looked at: for
// its waits the thread's own count of launches does (waits.cpp), and what is recorded behind
// its work is written into the table of events, without taking it.
//
// Where the task is busy with another thread, what would have been learned is not; then an event
// that is recorded is of nothing.
#include "host/runtime/work_on_streams.h"

#include <algorithm>

#include "host/base/memory_orders.h"
#include "host/identity/stream_id.h"

namespace urgengo::runtime {
namespace {

/// num_launched(), by its owner without taking it; nothing if a helper is at it.
std::optional<std::uint64_t> num_launched_by_owner(const TaskState& task) {
    const std::uint32_t counted = task.unasked.counted.load(kAcquire);
    const std::uint64_t launches = task.counters.launches.load(kAcquire);
    // Who counts does so between taking the task and letting go of it: it is seen at it, or to have
    // counted.
    if (task.taking.busy.load(kAcquire) || task.unasked.counted.load(kAcquire) != counted)
        return std::nullopt;
    return launches + (task.slot->as_planned.load(kRelaxed) - counted);
}

bool has_recorded(const ThreadState& thread, CUevent event) {
    return std::any_of(thread.waits.events.begin(), thread.waits.events.end(),
                       [&](const auto& e) { return e.event == event; });
}

bool last_stream_ends(const TaskState& task) {
    return task.streams.closing.last_stream_ends(task.plan.segments().size());
}

}  // namespace

TaskState* WorkOnStreams::owner(CUstream stream) const {
    const int owner = owners_.owner(stream);
    return owner >= 0 ? &common_.roster.task(owner) : nullptr;
}

TaskState* WorkOnStreams::task_on(ThreadState& thread, CUstream stream) const {
    if (TaskState* own = Runs::own_task(thread)) return own;
    return exec::is_default_stream(stream) ? nullptr : owner(stream);
}

void WorkOnStreams::follow(TaskState& task, const Launch& launch) {
    const progress::StreamId to = identity::stream_id(launch.stream, launch.flavor);
    if (task.streams.graph.current() == to) [[likely]]
        return;
    task.streams.graph.move_to(
        to, identity::stream_kind(common_.driver, task.streams.graph, launch.stream, launch.flavor),
        num_launched(task));
    if (task.streams.graph.is_lost()) task.streams.were_lost.store(true, kRelaxed);
    task.streams.note();
}

void WorkOnStreams::recorded(ThreadState& thread, CUevent event, CUstream stream,
                             exec::StreamFlavor flavor) {
    TaskState* task = task_on(thread, stream);
    if (!task) return events_.forget(event);
    progress::RecordedEvent record{.task = task->index, .covered = {}, .gpu_time = {}};
    const bool is_on_line = thread.task == task && thread.line.stream == stream &&
                            (stream || thread.line.flavor == flavor);
    if (is_on_line && !task->streams.is_forked.load(kRelaxed)) {
        if (const auto launched = num_launched_by_owner(*task)) {
            record.covered.all = *launched;
            record.gpu_time = nanoseconds(task->slot->launched_ns.load(kRelaxed));
            return events_.recorded(event, record);
        }
    }
    if (!runs_.take(thread, *task)) return events_.forget(event);
    const progress::StreamId id = identity::stream_id(stream, flavor);
    const bool is_known = task->streams.graph.knows(id);
    const auto kind = identity::is_legacy(stream, flavor) ? progress::StreamKind::kLegacy
                                                          : progress::StreamKind::kNonBlocking;
    record.covered = task->streams.graph.covered_by(id, kind, num_launched(*task));
    record.gpu_time = task->work.launched;
    runs_.release(thread);
    if (is_known || kind == progress::StreamKind::kLegacy)
        events_.recorded(event, record);
    else
        events_.forget(event);
}

void WorkOnStreams::stream_waits(ThreadState& thread, CUstream stream, exec::StreamFlavor flavor,
                                 CUevent event) {
    if (common_.mode() == config::Mode::kOff) return;
    const auto record = events_.find(event);
    if (!record || common_.streams.is_capturing(stream, flavor)) return;
    TaskState& task = common_.roster.task(record->task);
    TaskState* own = Runs::own_task(thread);
    if (own && own != &task) return runs_.lend_along(*own, task, record->gpu_time);
    if (!own) {  // what begins behind it waits, too
        thread.waits.lends_to = &task;
        thread.waits.lends_until = record->gpu_time;
    }
    // On the stream that it was recorded on, if there is only that.
    const bool is_on_line =
        own && thread.line.stream == stream && (stream || thread.line.flavor == flavor);
    if (is_on_line && !task.streams.is_forked.load(kRelaxed)) return;
    if (!runs_.take(thread, task)) return;
    task.streams.graph.waits_for(
        identity::stream_id(stream, flavor),
        identity::stream_kind(common_.driver, task.streams.graph, stream, flavor), record->covered,
        num_launched(task));
    task.streams.note();
    runs_.release(thread);
}

// Is this a wait for all that the task has launched? And what is known to have executed after it.
// If no thread waits for a task's side streams, its last launch alone tells
// (progress/closing_rule.h).
std::optional<bool> WorkOnStreams::covers_all(ThreadState& thread, const Wait& wait, bool by_last) {
    thread.waits.waited_for.task = nullptr;
    if (wait.function == abi::TraceWait::kContext) return std::nullopt;
    std::optional<progress::RecordedEvent> record;
    TaskState* task = Runs::own_task(thread);
    if (wait.event) {
        // Without a fork the thread's own events tell; unless another thread has recorded it.
        if (task ? !task->streams.is_forked.load(kRelaxed) && has_recorded(thread, wait.event)
                 : thread.line.passes)
            return std::nullopt;
        record = events_.find(wait.event);
        if (!record)
            return task && task->streams.is_forked.load(kRelaxed) ? std::optional(false)
                                                                  : std::nullopt;
        TaskState* const its = &common_.roster.task(record->task);
        if (task && task != its) {
            const bool is_query = wait.function == abi::TraceWait::kEventQuery;
            runs_.lend_along(*task, *its, record->gpu_time, !is_query);
            return std::nullopt;
        }
        task = its;
    } else if (!task) {
        task = task_on(thread, wait.stream);
    }
    if (!task || (!wait.event && !task->streams.is_forked.load(kRelaxed))) return std::nullopt;
    if (!runs_.take(thread, *task)) return std::nullopt;
    const std::uint64_t launched = num_launched(*task);
    const auto kind = identity::is_legacy(wait.stream, wait.flavor)
                          ? progress::StreamKind::kLegacy
                          : progress::StreamKind::kNonBlocking;
    thread.waits.waited_for = {
        .task = task,
        .is_last = by_last,
        .covered = record ? record->covered
                          : task->streams.graph.covered_by(
                                identity::stream_id(wait.stream, wait.flavor), kind, launched)};
    const bool is_lost = task->streams.graph.is_lost();
    const bool all = task->streams.graph.covers_all(thread.waits.waited_for.covered, launched) ||
                     (by_last && last_stream_ends(*task));
    runs_.release(thread);
    if (is_lost) {  // the thread's own count tells
        thread.waits.waited_for.task = nullptr;
        return std::nullopt;
    }
    return thread.task == task ? std::optional(all) : std::nullopt;
}

// A helper may have launched meanwhile.
bool WorkOnStreams::covered_has_executed(ThreadState& thread, TaskState& task) {
    if (!runs_.take(thread, task)) return false;
    const std::uint64_t launched = num_launched(task);
    const bool is_last = thread.waits.waited_for.is_last;
    const bool all = task.streams.graph.covers_all(thread.waits.waited_for.covered, launched);
    task.streams.graph.executed(thread.waits.waited_for.covered, launched);
    if (all)
        task.streams.closing.all_covered();
    else if (is_last)
        task.streams.closing.left_something_open(launched);
    const bool ends = all || (is_last && last_stream_ends(task));
    task.streams.note();
    runs_.release(thread);
    return ends;
}

bool WorkOnStreams::destroyed(CUstream stream) {
    owners_.forget(stream);
    if (!exec::is_default_stream(stream)) forget_work_on(stream);
    return common_.streams.destroyed(stream);
}

void WorkOnStreams::forget_work_on(CUstream stream) {
    const auto id = identity::stream_id(stream, exec::StreamFlavor::kLegacy);
    for (const auto& task : common_.roster.tasks()) {
        if (!task->streams.was_forked.load(kRelaxed)) continue;
        if (!runs_.take(*task)) {
            task->taking.streams_are_gone.store(true);
            continue;
        }
        task->streams.graph.forget(id, num_launched(*task));
        runs_.let_go(*task);
    }
}

}  // namespace urgengo::runtime
