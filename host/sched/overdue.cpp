// SPDX-License-Identifier: Apache-2.0
#include "host/sched/overdue.h"

#include <algorithm>
#include <atomic>

#include "host/base/memory_orders.h"
#include "host/sched/admission.h"

namespace urgengo::sched {
namespace {

/// Overdue work is passed over for so long before others give way to it.
constexpr nanoseconds kPassedOver{10'000'000};
/// They do for so much of the time that it has waited, at least: a sixteenth.
constexpr int kDrainShare = 16;

/// @returns whether it is time for that
bool clear_the_way(abi::TaskSlot& slot, const SlotView& overdue, nanoseconds drained,
                   nanoseconds now) {
    std::int64_t last = slot.cleared_until_ns.load(kRelaxed);
    const nanoseconds waited_then = nanoseconds(last) - (now - overdue.ahead.waited);
    if (overdue.ahead.waited < std::max(kPassedOver, 2 * waited_then)) return false;
    // Unknown work is drained later than it should be.
    const nanoseconds until =
        now + overdue.ahead.patience + std::max(drained, overdue.ahead.waited / kDrainShare);
    return slot.cleared_until_ns.compare_exchange_strong(last, until.count(), kRelaxed);
}

void way_is_clear(abi::TaskSlot& slot, const SlotView& overdue, nanoseconds now) {
    const std::int64_t until = (now + overdue.ahead.patience).count();
    std::int64_t last = slot.cleared_until_ns.load(kRelaxed);
    if (until < last) slot.cleared_until_ns.compare_exchange_strong(last, until, kRelaxed);
}

}  // namespace

bool look_after_overdue(const config::Scheduler& scheduler, const Snapshot& snapshot,
                        const Tasks& tasks) {
    const auto is_let_by = [](const SlotView& v) { return v.state.overdue && !v.state.blocking; };
    const auto is_at_work = [](const SlotView& v) {
        return !v.state.overdue && v.ahead.launched.count() > 0;
    };
    if (std::none_of(snapshot.tasks.begin(), snapshot.tasks.end(), is_at_work))
        for (const SlotView& v : snapshot.tasks)
            if (v.state.overdue && v.state.blocking)
                way_is_clear(*tasks[v.task].slot, v, snapshot.now);
    if (std::none_of(snapshot.tasks.begin(), snapshot.tasks.end(), is_let_by)) return false;
    const TaskSet slots = passed_over(scheduler, snapshot);
    nanoseconds drained{0};
    for (const SlotView& v : snapshot.tasks) drained += v.ahead.launched;
    bool cleared = false;
    for (const SlotView& v : snapshot.tasks)
        if (slots.contains(v.task))
            cleared |=
                clear_the_way(*tasks[v.task].slot, v, drained - v.ahead.launched, snapshot.now);
    return cleared;
}

}  // namespace urgengo::sched
