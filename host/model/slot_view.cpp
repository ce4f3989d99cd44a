// SPDX-License-Identifier: Apache-2.0
#include "host/model/slot_view.h"

#include <algorithm>

#include "host/model/lent_deadline.h"
#include "host/model/position.h"
#include "host/model/starvation.h"
#include "host/model/unmarked_work.h"

namespace urgengo::model {
namespace {

using abi::TaskSlot;
using abi::TaskState;

constexpr auto kRelaxed = std::memory_order_relaxed;
constexpr auto kAcquire = std::memory_order_acquire;

nanoseconds launched_at(const TaskSlot& slot, std::uint32_t mark) {
    return nanoseconds(slot.launched_at_mark_ns[mark % abi::kMarkRing].load(kRelaxed));
}

/// After which what should take so long is overdue.
constexpr nanoseconds patience_for(nanoseconds estimate) {
    return 2 * estimate + kOverdue;
}

bool is_later(std::uint32_t a, std::uint32_t b) {
    return static_cast<std::int32_t>(a - b) > 0;
}

// Publishes progress. Two readers may race: the older reading loses, or is put right by the next.
bool advance_progress(TaskSlot& slot, std::uint32_t done, nanoseconds now) {
    std::uint32_t seen = slot.marks_done.load(kRelaxed);
    if (!is_later(done, seen)) return false;
    if (!slot.marks_done.compare_exchange_strong(seen, done, kRelaxed)) return false;
    // It was overdue until now, or until some moment since the last look.
    const nanoseconds estimate = corrected(slot, launched_at(slot, done) - launched_at(slot, seen));
    const nanoseconds waited = now - nanoseconds(slot.progress_ns.load(kRelaxed));
    gave_way(slot, waited - patience_for(estimate));
    slot.progress_ns.store(now.count(), kRelaxed);
    return true;
}

void read_chain(const TaskSlot& slot, SlotView& view) {
    view.period = nanoseconds(slot.period_ns.load(kRelaxed));
    view.relative_deadline = nanoseconds(slot.relative_deadline_ns.load(kRelaxed));
    view.chain_gpu = nanoseconds(slot.chain_gpu_ns.load(kRelaxed));
    view.chain_cpu = nanoseconds(slot.chain_cpu_ns.load(kRelaxed));
    view.criticality = slot.criticality.load(kRelaxed);
    view.static_rank = static_cast<int>(slot.static_rank.load(kRelaxed));
    view.mean_utilization = slot.mean_utilization_ppm.load(kRelaxed) * 1e-6;
    view.is_supported = slot.is_supported.load(kRelaxed) != 0;
    view.launching = slot.launching.load(kRelaxed);
}

}  // namespace

nanoseconds corrected(const TaskSlot& slot, nanoseconds estimated) {
    const std::uint32_t ppm = slot.factor_ppm.load(kRelaxed);
    if (ppm == 0) return estimated;
    return nanoseconds(
        static_cast<std::int64_t>(static_cast<double>(estimated.count()) * (ppm * 1e-6)));
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
    SlotView view;
    view.task = task;

    const std::uint32_t version = slot.version.load(kAcquire);
    const TaskState state = slot.state.load(kAcquire);
    if (version % 2 != 0 || state == TaskState::kIdle) return view;
    const bool on_cpu = state == TaskState::kCpu;
    view.active = true;

    // Acquire: the second look at the version comes after all of these.
    view.deadline = nanoseconds(slot.deadline_ns.load(kAcquire));
    view.later_gpu = nanoseconds(slot.later_gpu_ns.load(kAcquire));
    view.later_cpu = nanoseconds(slot.later_cpu_ns.load(kAcquire));
    const nanoseconds cpu_until(slot.cpu_until_ns.load(kAcquire));
    view.utilization = slot.head_utilization_ppm.load(kAcquire) * 1e-6;
    const nanoseconds head(slot.head_remaining_ns.load(kAcquire));
    const nanoseconds head_idle(slot.head_idle_ns.load(kAcquire));
    const nanoseconds launched(slot.launched_ns.load(kAcquire));
    const nanoseconds last_launch(slot.launch_ns.load(kAcquire));
    const nanoseconds last_look(slot.look_ns.load(kAcquire));
    std::uint32_t issued = slot.marks_issued.load(kAcquire);
    std::uint32_t done = slot.marks_done.load(kAcquire);
    if (line) {
        // Never back: marks of two streams may arrive out of order.
        const std::uint32_t seen = read_marks_done(*line, issued, done);
        if (is_later(seen, done)) done = seen;
        view.progressed = advance_progress(slot, done, now);
    }
    if (is_later(done, issued)) issued = done;
    // With more marks in flight than the ring holds, the oldest that it still has.
    if (issued - done >= abi::kMarkRing) done = issued - abi::kMarkRing + 1;

    view.launched = corrected(slot, std::max(launched - launched_at(slot, done), nanoseconds{0}));
    view.started = slot.started.load(kRelaxed) != 0;
    view.release = on_cpu ? std::max(now, cpu_until) : now;
    // What no mark can tell of goes by time, from the last one on.
    nanoseconds under_way = view.launched;
    if (const nanoseconds until(slot.unmarked_until_ns.load(kRelaxed));
        until.count() != 0 && issued == done)
        under_way = UnmarkedWork::left(view.launched, until,
                                       nanoseconds(slot.progress_ns.load(kRelaxed)), now);
    view.remaining_gpu = corrected(slot, head) + under_way + view.later_gpu;
    // While it has work there, the GPU waits for no launch.
    view.later_idle = nanoseconds(slot.later_idle_ns.load(kRelaxed));
    view.remaining_idle = view.later_idle + std::max(head_idle - under_way, nanoseconds{0});
    view.remaining_cpu = view.later_cpu + view.release - now;
    read_chain(slot, view);
    view.laxity =
        laxity({view.deadline, view.remaining_gpu + view.remaining_idle, view.remaining_cpu}, now);

    view.demoted = slot.demotes.load(kRelaxed) != 0 && view.laxity.count() < 0;

    view.pending = issued != done;
    // A frame that came too early (sched/bandwidth.h) is as little urgent as one that is late,
    // until it is due.
    if (view.relative_deadline.count() > 0 && view.arrival() > now)
        view.laxity = std::min(view.laxity, nanoseconds{-1});

    if (view.pending) {
        const nanoseconds estimate =
            corrected(slot, launched_at(slot, done + 1) - launched_at(slot, done));
        const nanoseconds progress(slot.progress_ns.load(kRelaxed));
        view.waited = now - progress;
        view.patience = patience_for(estimate);
    } else if (view.launched.count() > 0) {
        view.waited = now - last_launch;
        view.patience = patience_for(view.launched);
    }
    view.overdue = view.waited > view.patience;
    // A task whose turn has come is still overdue, or held.
    view.starved =
        is_starved(slot, view.deadline, view.relative_deadline, view.waited - view.patience, now);
    // It waits for the work of all tasks: no less urgent task may add to that. When that work
    // should be done and is not, the task counts for what it has on the GPU, as any other.
    const bool waits_for_all =
        state == TaskState::kSync && now.count() <= slot.sync_until_ns.load(kRelaxed);
    view.needs_all = waits_for_all;
    if (waits_for_all) {
        view.utilization = 1;
        view.overdue = false;
    }
    const bool held = state == TaskState::kHeld && now - last_look < kHeldHeartbeat;
    const nanoseconds last = std::max(last_launch, last_look);
    const bool between_launches = now - last < kLaunchGrace;
    const bool has_more = head.count() > 0;
    const bool waits_to_launch = held && slot.queue_why.load(kRelaxed) == abi::Why::kTurnToLaunch;
    view.launches = is_launching(state, head, last, now) || (has_more && waits_to_launch);
    view.pauses = has_more && state == TaskState::kGpu && !view.launches;
    view.ranked =
        !on_cpu && (waits_for_all || held || between_launches || view.launched.count() > 0);
    view.blocking =
        view.ranked && (!view.overdue || now.count() < slot.cleared_until_ns.load(kRelaxed));

    if (const auto loan = lent_deadline(slot, launched_at(slot, done))) [[unlikely]]
        apply_loan(view, *loan,
                   std::min(corrected(slot, loan->until - launched_at(slot, done)), view.launched),
                   now);

    // A slot that changed hands under us belongs to an instance that has just begun or ended.
    if (slot.version.load(kRelaxed) != version) view.active = view.ranked = view.blocking = false;
    return view;
}

}  // namespace urgengo::model
