// SPDX-License-Identifier: Apache-2.0
#include "host/model/slot_view.h"

#include <algorithm>

#include "host/base/memory_orders.h"
#include "host/model/position.h"
#include "host/model/starvation.h"
#include "host/model/task_reading.h"

namespace urgengo::model {
namespace {

using abi::TaskSlot;
using abi::TaskState;

nanoseconds launched_at(const TaskSlot& slot, std::uint32_t mark) {
    return nanoseconds(slot.launched_at_mark_ns[mark % abi::kMarkRing].load(kRelaxed));
}

// Publishes progress. Two readers may race: the older reading loses, or is put right by the next.
bool advance_progress(TaskSlot& slot, std::uint32_t done, nanoseconds now) {
    std::uint32_t seen = slot.marks_done.load(kRelaxed);
    if (!is_later_mark(done, seen)) return false;
    if (!slot.marks_done.compare_exchange_strong(seen, done, kRelaxed)) return false;
    // It was overdue until now, or until some moment since the last look.
    const nanoseconds estimate = corrected(slot, launched_at(slot, done) - launched_at(slot, seen));
    const nanoseconds waited = now - nanoseconds(slot.progress_ns.load(kRelaxed));
    gave_way(slot, waited - patience_for(estimate));
    slot.progress_ns.store(now.count(), kRelaxed);
    return true;
}

}  // namespace

nanoseconds corrected(const TaskSlot& slot, nanoseconds estimated) {
    return corrected_by(slot.factor_ppm.load(kRelaxed), estimated);
}

std::uint32_t read_marks_done(const ug_mark_line& line, std::uint32_t marks_issued,
                              std::uint32_t fallback) {
    const auto mark = read_mark(line, marks_issued);
    return mark ? mark->sequence : fallback;
}

bool is_launching(const TaskSlot& slot, nanoseconds now) {
    return is_launching(
        slot.state.load(kRelaxed), nanoseconds(slot.head_remaining_ns.load(kRelaxed)),
        nanoseconds(std::max(slot.launch_ns.load(kRelaxed), slot.look_ns.load(kRelaxed))), now);
}

SlotView read_slot(TaskSlot& slot, const ug_mark_line* line, int task, nanoseconds now) {
    SlotView idle;
    idle.task = task;
    const std::uint32_t version = slot.version.load(kAcquire);
    if (version % 2 != 0 || slot.state.load(kAcquire) == TaskState::kIdle) return idle;

    // Acquire: the second look at the version comes after all of these.
    TaskReading reading = load_slot(slot);
    if (reading.state == TaskState::kIdle) return idle;
    const std::uint32_t issued = slot.marks_issued.load(kAcquire);
    std::uint32_t done = slot.marks_done.load(kAcquire);
    bool progressed = false;
    if (line) {
        // Never back: marks of two streams may arrive out of order.
        const std::uint32_t seen = read_marks_done(*line, issued, done);
        if (is_later_mark(seen, done)) done = seen;
        progressed = advance_progress(slot, done, now);
    }
    // Of that mark, or of a later one: written by the thread that saw it first, or that launched
    // into an idle GPU.
    reading.last.progress_ns = slot.progress_ns.load(kAcquire);
    load_marks(reading, slot, issued, done);

    SlotView view = view_of(reading, task, now);
    view.ahead.progressed = progressed;
    // A task whose turn has come is still overdue, or held. Of its own deadline, lent or not.
    view.state.starved =
        is_starved(slot, nanoseconds(reading.deadline_ns), view.chain.relative_deadline,
                   view.ahead.waited - view.ahead.patience, now);
    // A slot that changed hands under us belongs to an instance that has just begun or ended.
    if (slot.version.load(kRelaxed) != version)
        view.state.active = view.state.ranked = view.state.blocking = false;
    return view;
}

}  // namespace urgengo::model
