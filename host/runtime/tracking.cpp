// SPDX-License-Identifier: Apache-2.0
//
// The paper's ways of knowing the executing kernel (`tracking:`, section 4.3.3 of the paper),
// beside progress marks and for comparison with them. What each learns is published in the task's
// slot and line as marks are, with sequence numbers of its own, so whoever reads progress reads it
// unchanged:
//
//   async       nothing is asked. What has been launched counts as executed, all but a nanosecond:
//               the task stays on the GPU until the program's own wait, as if that were the mark of
//               the whole segment.
//   sync        after every launch the thread waits until it has executed.
//   batched     after every batch of launches, `eval_interval_us` of estimated GPU time.
//   overlapped  before the batch after next begins, until the last batch but one has executed: one
//               batch executes while the next is launched.
//
// A wait of ours asks for an event that was recorded behind the work, and does not call
// cuStreamSynchronize: that would never return where the work waits for something that this very
// thread does later (a value in memory, a host function). It asks without pause for as long as a
// spinning synchronisation of the driver's would pay, then with sleeps between; it ends by GPU
// progress, or after what an instance may be held, and then the instance is waited for no more.
// (While an event is pending, asking costs 0.09 us: H200, driver 580.159.04, 2026-11-21.) What the
// driver says to it, if the context is broken, it says to the program's next call, too.
//
// Where no mark may be, nobody waits: captures, launches that depend on each other
// programmatically, one launch between two timing events. A run-ahead is not bounded: that is what
// the waits do.
#include <algorithm>
#include <optional>

#include "host/runtime/runtime.h"

namespace urgengo::runtime {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
using abi::TaskSlot;
using config::Tracking;

/// About 1 ms, longer than most batches. In that time a sleep would be noticed.
constexpr int kAsksWithoutPause = 10'000;
/// Later: a 32nd of the wait so far, within these.
constexpr nanoseconds kFinest{20'000};
constexpr nanoseconds kCoarsest{100'000};
/// Batches that were never seen to end take no more than so many places of the ring.
constexpr std::uint32_t kMaxOpen = abi::kMarkRing / 2;

}  // namespace

bool Runtime::batch_is_due(const TaskState& task) const {
    const sched::GovernedRun& run = task.run;
    const TrackedRun& tracked = task.tracked;
    if (tracked.waited_in_vain) return false;
    switch (scheduler_.tracking) {
        case Tracking::kSync: {
            const std::uint32_t issued = task.slot->marks_issued.load(kRelaxed);
            return run.position != run.position_at_mark[issued % abi::kMarkRing];
        }
        case Tracking::kBatched:
        case Tracking::kOverlapped:
            return task.launched - task.marked >= scheduler_.eval_interval;
        case Tracking::kAsync:
        case Tracking::kProgress:
            break;
    }
    return false;
}

// The task has entered the GPU; its line is ours alone.
void Runtime::begin_tracking(TaskState& task) {
    TrackedRun& tracked = task.tracked;
    ug_mark_line& line = tracked.marks->lines[task.index];
    __atomic_store_n(&line.clock, UG_MARK_CLOCK_HOST, __ATOMIC_RELEASE);
    if (scheduler_.tracking != Tracking::kAsync) return;
    TaskSlot& slot = *task.slot;
    // The program's wait for the last segment may never have been seen: then that batch goes on.
    std::uint32_t sequence = slot.marks_issued.load(kRelaxed);
    if (sequence == task.published) ++sequence;
    slot.launched_at_mark_ns[(sequence - 1) % abi::kMarkRing].store(task.launched.count(),
                                                                    kRelaxed);
    issue(task, sequence);
}

// Of async: the launch counts as executed. What the segment is thought to take is kept as the open
// batch's estimate, so that it is late only when the whole of it is.
void Runtime::count_as_executed(TaskState& task, nanoseconds estimate) {
    sched::GovernedRun& run = task.run;
    TaskSlot& slot = *task.slot;
    const std::uint32_t open = slot.marks_issued.load(kRelaxed);
    auto& executed = slot.launched_at_mark_ns[(open - 1) % abi::kMarkRing];
    auto& end = slot.launched_at_mark_ns[open % abi::kMarkRing];
    const std::int64_t segment =
        end.load(kRelaxed) - executed.load(kRelaxed) + std::int64_t{estimate.count()};
    executed.store(task.launched.count() - 1, kRelaxed);
    end.store(task.launched.count() - 1 + segment, kRelaxed);
    run.position_at_mark[(open - 1) % abi::kMarkRing] = run.position;
    task.marked = task.launched;
}

// By the thread that has the task, in the context of its marks, outside of captures.
void Runtime::end_batch(TaskState& task) {
    if (scheduler_.tracking == Tracking::kAsync || task.tracked.waited_in_vain) return;
    const std::uint32_t issued = task.slot->marks_issued.load(kRelaxed);
    const std::uint32_t sequence = issued - task.published < kMaxOpen ? issued + 1 : issued;
    const CUevent event = batch_event(task, sequence);
    if (!event || !exec::record_event(driver_, event, task.tracked.stream, task.tracked.flavor))
        return refuse_marks(task);
    issue(task, sequence);
    if (scheduler_.tracking != Tracking::kOverlapped) wait_for_batch(task, sequence);
}

// The program has waited for all of it.
void Runtime::end_segment(TaskState& task) {
    const std::uint32_t issued = task.slot->marks_issued.load(kRelaxed);
    const std::uint32_t sequence = issued == task.published ? issued + 1 : issued;
    issue(task, sequence);
    publish(task, sequence);
}

void Runtime::issue(TaskState& task, std::uint32_t sequence) {
    TaskSlot& slot = *task.slot;
    task.run.position_at_mark[sequence % abi::kMarkRing] = task.run.position;
    slot.launched_at_mark_ns[sequence % abi::kMarkRing].store(task.launched.count(), kRelaxed);
    if (task.published == sequence - 1) slot.progress_ns.store(clock_.now().count(), kRelaxed);
    task.log.marked(nanoseconds(slot.look_ns.load(kRelaxed)), sequence);
    slot.marks_issued.store(sequence, std::memory_order_release);
    task.marked = task.launched;
}

/// @returns the event of that batch; null if refused
CUevent Runtime::batch_event(TaskState& task, std::uint32_t sequence) {
    return task.batch_events.at(driver_, task.tracked.marks, sequence % 2);
}

// Of overlapped. @param still_open  so many of the last batches may go on executing
bool Runtime::wait_for_batches(TaskState& task, std::uint32_t still_open) {
    if (scheduler_.tracking != Tracking::kOverlapped || task.tracked.waited_in_vain) return false;
    const std::uint32_t issued = task.slot->marks_issued.load(kRelaxed);
    if (issued - task.published <= still_open || marks_.prepare() != task.tracked.marks)
        return false;
    wait_for_batch(task, issued - still_open);
    return true;
}

void Runtime::wait_for_batch(TaskState& task, std::uint32_t sequence) {
    bump(task.counters.synchronisations);
    const CUevent event = batch_event(task, sequence);
    const nanoseconds begin = clock_.now(), bound = governor_.hold_bound(task);
    const exec::RelaxedCaptureMode relaxed(driver_);
    std::optional<FineTimerSlack> slack;
    for (int asked = 1;; ++asked) {
        const CUresult result = driver_.cuEventQuery(event);
        if (result == CUDA_SUCCESS) return publish(task, sequence);
        if (result != CUDA_ERROR_NOT_READY) return refuse_marks(task);
        if (asked < kAsksWithoutPause) continue;
        const nanoseconds waited = clock_.now() - begin;
        if (!governor_.schedules()) return;
        if (waited >= bound) {
            task.tracked.waited_in_vain = true;
            bump(task.counters.holds_opened);
            return;
        }
        if (!slack) slack.emplace();
        clock_.sleep_for(std::clamp(waited / 32, kFinest, kCoarsest));
    }
}

// As a mark writes it: first the word that says what, then the one that says when.
void Runtime::publish(TaskState& task, std::uint32_t sequence) {
    const sched::GovernedRun& run = task.run;
    const TrackedRun& tracked = task.tracked;
    ug_mark_line& line = tracked.marks->lines[task.index];
    const auto time_ns = static_cast<std::uint64_t>(clock_.now().count());
    const std::uint64_t word0 = ug_mark_word0(run.position_at_mark[sequence % abi::kMarkRing],
                                              instance_tag(*task.slot), sequence);
    __atomic_store_n(&line.word[0], word0, __ATOMIC_RELEASE);
    __atomic_store_n(&line.word[1], ug_mark_word1(time_ns, sequence), __ATOMIC_RELEASE);
    task.published = sequence;
}

}  // namespace urgengo::runtime
