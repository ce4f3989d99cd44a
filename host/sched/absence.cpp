// SPDX-License-Identifier: Apache-2.0
#include "host/sched/absence.h"

#include "host/base/memory_orders.h"

namespace urgengo::sched {

std::optional<Awaited> stalled(const abi::TaskSlot& slot, const model::SlotView& view,
                               nanoseconds jitter) {
    const abi::TaskState state = slot.state.load(kRelaxed);
    const bool on_cpu = state == abi::TaskState::kCpu;
    if (!view.state.active || (!on_cpu && state != abi::TaskState::kGpu)) return std::nullopt;
    nanoseconds due(slot.cpu_until_ns.load(kRelaxed));
    if (!on_cpu) {
        // Unmarked work that should be done is done, or its estimate is too short.
        const bool gpu_works =
            view.ahead.pending || (view.ahead.launched.count() > 0 &&
                                   view.ahead.waited <= 2 * view.ahead.launched + kStall);
        if (gpu_works) return std::nullopt;
        due = nanoseconds(std::max({slot.launch_ns.load(kRelaxed), slot.look_ns.load(kRelaxed),
                                    slot.progress_ns.load(kRelaxed)}));
    }
    const bool is_slowed = view.launching.slowed == model::Launching::kSlowed;
    const nanoseconds patience = on_cpu      ? jitter + kAbsenceMargin
                                 : is_slowed ? kStallAmongSlow
                                             : kStall;
    const nanoseconds since = due + patience;
    return Awaited{since, since + Expectation::longest_loan(view.period), view.deadline, patience};
}

}  // namespace urgengo::sched
