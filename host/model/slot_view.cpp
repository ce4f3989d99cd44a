// SPDX-License-Identifier: Apache-2.0
#include "host/model/slot_view.h"

#include <algorithm>

namespace urgengo::model {
namespace {

using abi::TaskSlot;
using abi::TaskState;

constexpr auto kRelaxed = std::memory_order_relaxed;

nanoseconds remaining_after(const TaskSlot& slot, std::uint32_t mark) {
    return nanoseconds(slot.remaining_after_mark_ns[mark % abi::kMarkRing].load(kRelaxed));
}

// Publishes progress. Two readers may race: the older reading loses, or is put right by the next.
void advance_progress(TaskSlot& slot, std::uint32_t done, nanoseconds now) {
    std::uint32_t seen = slot.marks_done.load(kRelaxed);
    if (static_cast<std::int32_t>(done - seen) <= 0) return;
    if (slot.marks_done.compare_exchange_strong(seen, done, kRelaxed))
        slot.progress_ns.store(now.count(), kRelaxed);
}

}  // namespace

std::uint32_t read_marks_done(const ug_mark_line& line, std::uint32_t marks_issued,
                              std::uint32_t fallback) {
    for (int attempt = 0; attempt < 4; ++attempt) {
        const auto tag = static_cast<std::uint16_t>(line.word[0]);
        if (tag != static_cast<std::uint16_t>(line.word[1])) continue;
        // Never more than 2^16 marks are in flight, so the tag names one sequence number.
        return marks_issued - static_cast<std::uint16_t>(marks_issued - tag);
    }
    return fallback;
}

SlotView read_slot(TaskSlot& slot, const ug_mark_line* line, int task, nanoseconds now) {
    SlotView view;
    view.task = task;

    const std::uint32_t version = slot.version.load(std::memory_order_acquire);
    const TaskState state = slot.state.load(kRelaxed);
    if (version % 2 != 0 || state == TaskState::kIdle || state == TaskState::kCpu) return view;

    view.deadline = nanoseconds(slot.deadline_ns.load(kRelaxed));
    const nanoseconds later_gpu(slot.later_gpu_ns.load(kRelaxed));
    const nanoseconds later_cpu(slot.later_cpu_ns.load(kRelaxed));
    view.utilization = slot.head_utilization_ppm.load(kRelaxed) * 1e-6;
    const nanoseconds head(slot.head_remaining_ns.load(kRelaxed));
    const nanoseconds unmarked(slot.unmarked_ns.load(kRelaxed));
    const nanoseconds activity(slot.activity_ns.load(kRelaxed));
    const std::uint32_t issued = slot.marks_issued.load(kRelaxed);
    std::uint32_t done = slot.marks_done.load(kRelaxed);
    if (line) {
        done = read_marks_done(*line, issued, done);
        advance_progress(slot, done, now);
    }
    // With more marks in flight than the ring holds, the oldest that it still has.
    if (issued - done >= abi::kMarkRing) done = issued - abi::kMarkRing + 1;
    const nanoseconds unfinished =
        issued == done ? nanoseconds{0}
                       : remaining_after(slot, done) - remaining_after(slot, issued);
    view.launched = std::max(unfinished, nanoseconds{0}) + unmarked;
    view.period = nanoseconds(slot.period_ns.load(kRelaxed));
    view.remaining_gpu = head + view.launched + later_gpu;
    view.remaining_cpu = later_cpu;
    view.laxity = laxity({view.deadline, view.remaining_gpu, view.remaining_cpu}, now);

    if (state == TaskState::kHeld) {
        view.blocking = now - activity < kHeldHeartbeat;
    } else if (now - activity < kLaunchGrace) {
        view.blocking = true;
    } else if (issued != done) {
        const nanoseconds estimate = remaining_after(slot, done) - remaining_after(slot, done + 1);
        const nanoseconds since = now - nanoseconds(slot.progress_ns.load(kRelaxed));
        view.blocking = since <= 2 * estimate + kOverdue;
    } else if (unmarked.count() > 0) {
        view.blocking = now - activity <= 2 * unmarked + kOverdue;
    }

    // A slot that changed hands under us belongs to an instance that has just begun or ended.
    std::atomic_thread_fence(std::memory_order_acquire);
    if (slot.version.load(kRelaxed) != version) view.blocking = false;
    return view;
}

}  // namespace urgengo::model
