// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/gpu_segments.h"

#include <algorithm>
#include <utility>

#include "host/base/memory_orders.h"
#include "host/config/progress_choice.h"
#include "host/identity/stream_id.h"
#include "host/sched/gpu_segment.h"
#include "host/sched/instance_slot.h"

namespace urgengo::runtime {
namespace {

using abi::TaskSlot;

using sched::MarkSpacing;
static_assert(MarkSpacing::kMostMarks < exec::EventContext::kRing,
              "no event is refused whose mark is not");
/// From one mark to the next of a task whose kernels overlap: each costs it a few microseconds.
constexpr nanoseconds kOverlapEvery{400'000};
/// Part of the run-ahead from where on a fork's branches are marked.
constexpr int kForkFrom = 4;

}  // namespace

GpuSegments::GpuSegments(Common& common)
    : common_(common),
      batches_(common.scheduler.progress.tracking, common.scheduler.progress.eval_interval,
               common.clock) {}

bool GpuSegments::enter(TaskState& task, nanoseconds now) {
    sched::GovernedRun& run = task.run;
    TrackedRun& tracked = task.tracked;
    tracked.marks = common_.marks.prepare();
    if (!tracked.marks) return false;
    run.priority.least = tracked.marks->least_priority;
    run.priority.greatest = tracked.marks->greatest_priority;
    CUdevice none = -1;
    if (device_.compare_exchange_strong(none, tracked.marks->device, kRelaxed))
        common_.observers.records.describe_gpu(common_.driver, tracked.marks->device);
    else if (none != tracked.marks->device)
        return false;  // another device: its work has nothing to do with ours
    TaskSlot& slot = *task.slot;
    ug_mark_line* line = &tracked.marks->lines[task.index];
    const std::uint32_t issued = slot.marks_issued.load(kRelaxed);
    if (task.line.load(kRelaxed) != line || task.line_of != tracked.marks->id) {
        // First use, or another context: the line must not look like progress that never was.
        __atomic_store_n(&line->word[0], ug_mark_word0(0, 0, issued), __ATOMIC_RELAXED);
        __atomic_store_n(&line->word[1], issued & 0xffffu, __ATOMIC_RELAXED);
        slot.marks_done.store(issued, kRelaxed);
        slot.launched_at_mark_ns[issued % abi::kMarkRing].store(task.work.launched.count(),
                                                                kRelaxed);
        task.log.marked(now, issued);
        task.work.marks_all();
        task.fork_is_over();
        task.batches.published = issued;
        task.line_of = tracked.marks->id;
        task.line.store(line, std::memory_order_release);
    }
    const nanoseconds cpu_begin = std::exchange(tracked.cpu_begin, nanoseconds{0});
    if (cpu_begin.count() > 0)
        common_.observers.causes.cpu_segment_ended(task, now - cpu_begin, now);
    sched::enter_gpu_segment(common_.governor, task,
                             {.cpu_segment = task.tracker.segment(),
                              .cpu_begin = cpu_begin,
                              .arrival = tracked.arrival,
                              .position = task.tracker.position()},
                             now);
    if (!common_.follows_marks()) batches_.begin_segment(batched(task));
    if (!common_.governor.company().is_alone()) common_.marks.watch();
    if (task.learning) common_.progress.segment_begins(task);
    FrameCauses::segment_begins(task, now);
    common_.observers.nvtx.segment_begins(task, now);
    common_.observers.records.segment_begins(task, now);
    return true;
}

void GpuSegments::leave(TaskState& task, bool idle) {
    if (!task.run.on_gpu) return;
    const nanoseconds now = common_.clock.now();
    sched::measure_gpu_segment(common_.governor, task, idle, task.tracker.position(), now);
    if (task.learning) {
        common_.progress.learn(task);
        task.learning->segment_ended(idle);
    }
    common_.observers.causes.segment_ended(task, idle, now);
    common_.observers.nvtx.segment_ends(task, idle, now);
    task.facts.would_hold.ends(now, common_.governor.hold_bound(task));
    common_.gate_keeper.segment_ended(task, now);
    common_.observers.records.segment_ended(task, idle, now);
    task.run.on_gpu = false;
    task.run.mark.tells = false;
    if (idle) {
        all_executed(task);
        task.streams.all_executed(num_launched(task));
        if (!common_.follows_marks()) batches_.end_segment(batched(task));
    }
    set_state(task, abi::TaskState::kCpu);
    common_.governor.leaves_gpu(task, now);
}

void GpuSegments::all_executed(TaskState& task) {
    const std::uint32_t issued = task.slot->marks_issued.load(kRelaxed);
    task.log.marked(task.log.mark_time(issued), issued);  // launched when it was
    sched::all_executed(task);
}

// A program that launches more slowly than the GPU executes needs no mark for its pace: what it has
// launched since the last one has executed by now, but for what it launched just now, and that is
// little. That is as good as a mark for a task that no other looks at, as an arriving task finds
// one before its next launch; and costs nothing. Now and then a mark is due even so: what is not on
// the GPU's own word is not believed for long.
bool GpuSegments::must_have_executed(TaskState& task, nanoseconds now) {
    sched::GovernedRun& run = task.run;
    if (!task.gates.is_open || !common_.follows_marks() || !common_.governor.company().is_alone() ||
        common_.scheduler.progress.learn || task.work.assumed >= kMostAssumed ||
        !launches_slowly(task, now))
        return false;
    // Time before the last launch is not the time that it took.
    const std::uint32_t last = task.log.count() - 1;
    const nanoseconds of_last = task.log.end(last) - task.log.end(last - 1);
    if (of_last > mark_every(task, now) && now - task.log.time(last) < 2 * of_last) return false;
    // A mark that is under way is late, or tells soon enough.
    if (!all_marks_seen(task)) common_.governor.tasks().look(task, now);
    if (!all_marks_seen(task)) return false;
    all_executed(task);
    run.mark.at = now;
    ++task.work.assumed;
    task.record.is_slow = true;
    run.mark.was_slow = false;
    return true;
}

// Since the last mark, or what was taken for one: at half of the GPU's speed or less, by the
// estimates; at four fifths of it where no other task has looked for a while (among ten chains,
// then remaining work was off by 560 us at 99 % instead of 240: H200). Not where we have made it
// wait, as it is no faster then, however short its estimates are. Unknown kernels have no
// estimates: what is known is that none was in the way of the last mark (see_whether_slow), and
// launches that are as fast as a loop can make them are not believed to be slow.
bool GpuSegments::launches_slowly(const TaskState& task, nanoseconds now) const {
    const sched::GovernedRun& run = task.run;
    if (run.waited.paced + run.waited.held != run.mark.waited) return false;
    const nanoseconds least = task.work.launched - task.work.marked;
    const nanoseconds time = now - run.mark.at, took = task.planned(time);
    if (task.plan.is_empty())
        return task.record.is_slow && std::min(time, took) >= least / kLeastOfUnknown;
    return took >= (common_.governor.company().no_other_looks(now) ? least + least / 4 : 2 * least);
}

// The oldest mark that was not seen: by itself, or by the thread that asks for events.
bool GpuSegments::is_looked_for(const TaskState& task) {
    const ug_mark_line& line = *task.line.load(kRelaxed);
    if (__atomic_load_n(&line.clock, __ATOMIC_ACQUIRE) != UG_MARK_CLOCK_HOST) return true;
    const auto looked_ns =
        static_cast<std::int64_t>(__atomic_load_n(&line.looked_ns, __ATOMIC_ACQUIRE));
    const std::uint32_t done = task.slot->marks_done.load(kRelaxed);
    return nanoseconds(looked_ns) > task.log.mark_time(done + 1);
}

// What tells of unknown kernels: by the launch behind the one that the mark came before, the mark
// has executed, and with it all that was launched before it.
void GpuSegments::see_whether_slow(TaskState& task, nanoseconds now) {
    sched::GovernedRun& run = task.run;
    if (!std::exchange(run.mark.tells, false) || !common_.governor.company().is_alone()) return;
    common_.governor.tasks().look(task, now);
    if (!all_marks_seen(task) && !is_looked_for(task)) {
        run.mark.tells = true;
        return;
    }
    task.record.is_slow =
        run.waited.paced + run.waited.held == run.mark.waited && all_marks_seen(task);
}

// Marks tell the others where a task is. Alone it has half as many, as nothing slows it down:
// unless its kernels' times are learned. Where there have been no others for a while, they serve
// its own pace alone, for which two in its run-ahead do. And one for a slow program, which mostly
// needs none (must_have_executed), but is asked. Not more seldom than that: an arriving task
// reckons with all that is launched behind the last one.
nanoseconds GpuSegments::mark_every(const TaskState& task, nanoseconds now) const {
    const nanoseconds every = config::mark_every(common_.scheduler, task.tracked.marks->source);
    return common_.governor.ahead().mark_spacing.between(task, every, now);
}

// A mark ends the overlap of a kernel with a next one that depends on it programmatically. A task
// that does such things is marked seldom, and by itself only where it is held or waits; but where
// others look at it, what it has launched must not seem to be under way for ever.
bool GpuSegments::mark_is_due(TaskState& task, nanoseconds now) {
    if (task.record.overlaps)
        return common_.follows_marks() && !common_.governor.company().is_alone() &&
               !MarkSpacing::ring_is_full(*task.slot) &&
               task.work.launched - task.work.marked >= task.planned(kOverlapEvery);
    const TaskSlot& slot = *task.slot;
    if (MarkSpacing::under_way(slot) >= MarkSpacing::kManyMarks) [[unlikely]] {
        common_.governor.tasks().look(task, now);
        if (MarkSpacing::ring_is_full(slot)) return false;
    }
    return common_.follows_marks() ? task.work.launched - task.work.looked >= mark_every(task, now)
                                   : batches_.is_due(batched(task));
}

void GpuSegments::mark_if_worth_it(TaskState& task, nanoseconds now) {
    if (!common_.governor.looks_instead_of_mark(task, now)) emit_mark(task, now);
}

void GpuSegments::refuse_marks(TaskState& task) {
    task.tracked.marks_refused = true;
    task.is_unseen.store(true, kRelaxed);
    bump(task.counters.marks_refused);
    leave(task, false);
}

void GpuSegments::emit_mark(TaskState& task, nanoseconds now, Place place) {
    sched::GovernedRun& run = task.run;
    TrackedRun& tracked = task.tracked;
    if (common_.streams.is_capturing(tracked.stream, tracked.flavor) ||
        common_.marks.prepare() != tracked.marks)
        return;
    if (!common_.follows_marks()) return end_batch(task);
    if (task.learning) common_.progress.learn(task);
    TaskSlot& slot = *task.slot;
    if (MarkSpacing::ring_is_full(slot)) return;
    const std::uint32_t sequence = slot.marks_issued.load(kRelaxed) + 1;
    // The ring's entry is complete before the GPU can execute the mark.
    run.position_at_mark[sequence % abi::kMarkRing] = run.position;
    slot.launched_at_mark_ns[sequence % abi::kMarkRing].store(task.work.launched.count(), kRelaxed);
    // Any time before it is launched does for the log; the later, the more it tells of the GPU's
    // clock (model/gpu_clock.h), and most does a mark that nothing is before.
    if (slot.marks_done.load(kRelaxed) == sequence - 1) {
        now = common_.clock.now();
        slot.progress_ns.store(now.count(), kRelaxed);
    }
    task.log.marked(now, sequence, identity::stream_id(tracked.stream, tracked.flavor));
    const std::uint64_t word0 = ug_mark_word0(run.position, instance_tag(slot), sequence);
    // A stream of the pool joins the program's by an event, which is no kernel to wait for.
    const bool may_overlap =
        !task.record.overlaps && common_.scheduler.priority.via != config::PriorityVia::kStreamPool;
    const CUresult result = common_.marks.emit(
        *tracked.marks,
        {.task = task.index,
         .word0 = word0,
         .sequence = sequence,
         .stream = tracked.stream,
         .flavor = tracked.flavor,
         .may_overlap = may_overlap,
         .time = now,
         .is_watched = common_.marks_all() || !common_.governor.company().no_other_looks(now),
         .gate = slot.gates_closed.load(kRelaxed),
         .is_before_gate = place == Place::kBeforeGate,
         .ends_segment = place == Place::kAtEnd,
         .threads = common_.mark_width.threads(now)});
    if (result == CUDA_ERROR_NOT_READY) return;  // so many are under way: the next launch is marked
    if (result != CUDA_SUCCESS) return refuse_marks(task);
    slot.marks_issued.store(sequence, std::memory_order_release);
    task.work.marks_all();
    run.mark.at = now;
    run.mark.waited = run.waited.paced + run.waited.held;
    task.work.assumed = 0;
    run.mark.was_slow = std::exchange(task.record.is_slow, false);
    bump(task.counters.marks);
    common_.governor.estimates().sees_launchers(task, now);
}

void GpuSegments::launched(TaskState& task, nanoseconds estimate, nanoseconds now) {
    sched::publish_unmarked(task, task.tracked.unmarked,
                            !common_.follows_marks() || task.streams.graph.vouches(),
                            common_.governor.company().is_alone(), now);
    if (!common_.follows_marks()) return batches_.launched(batched(task), estimate);
    if (task.streams.graph.vouches()) [[likely]]
        return;
    task.fork.launched(task.streams.graph.branch(), estimate, task.work.launched - task.work.marked,
                       task.slot->marks_issued.load(kRelaxed));
}

void GpuSegments::mark_branch(TaskState& task, nanoseconds now) {
    if (!common_.follows_marks() || task.streams.graph.vouches()) [[likely]]
        return;
    const TrackedRun& tracked = task.tracked;
    if (task.record.overlaps || !common_.enforces(task) || task.record.lent_forks.are_free(now) ||
        common_.scheduler.admission == config::Admission::kNone ||
        tracked.marks->source.load(kRelaxed) != config::ProgressSource::kKernel)
        task.fork.is_not_marked();
    const nanoseconds from = task.planned(common_.scheduler.run_ahead.limit / kForkFrom);
    if (!task.fork.is_followed(task.slot->marks_issued.load(kRelaxed)) ||
        task.work.launched - task.work.marked < from)
        return;
    const int branch = task.streams.graph.branch();
    const nanoseconds every = mark_every(task, now);
    if (!task.fork.mark_is_due(branch, every) ||
        common_.streams.is_capturing(tracked.stream, tracked.flavor) ||
        common_.marks.prepare() != tracked.marks)
        return;
    const CUdeviceptr d_word = tracked.marks->d_lines + sizeof(ug_mark_line) * task.index +
                               offsetof(ug_mark_line, branch) +
                               sizeof(ug_mark_line::branch[0]) * branch;
    if (common_.marks.launch_at(*tracked.marks, d_word, task.fork.word(branch), 0, tracked.stream,
                                tracked.flavor,
                                common_.scheduler.priority.via != config::PriorityVia::kStreamPool,
                                common_.mark_width.threads(now)) != CUDA_SUCCESS)
        return task.fork.is_not_marked();
    task.fork.marked(branch);
    bump(task.counters.marks);
}

}  // namespace urgengo::runtime
