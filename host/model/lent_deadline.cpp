// SPDX-License-Identifier: Apache-2.0
#include "host/model/lent_deadline.h"

namespace urgengo::model {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;

}  // namespace

std::optional<LentDeadline> lent_deadline(const abi::TaskSlot& slot, nanoseconds executed) {
    const nanoseconds until(slot.lent_until_ns.load(std::memory_order_acquire));
    if (until <= executed) return std::nullopt;
    return LentDeadline{nanoseconds(slot.lent_deadline_ns.load(kRelaxed)), until,
                        slot.lent_criticality.load(kRelaxed),
                        static_cast<int>(slot.lent_static_rank.load(kRelaxed))};
}

bool lend_deadline(abi::TaskSlot& slot, const LentDeadline& loan, nanoseconds executed) {
    if (loan.until <= executed) return false;
    LentDeadline all = loan;
    const auto last = lent_deadline(slot, executed);
    if (last) {
        all = {std::min(last->deadline, loan.deadline), std::max(last->until, loan.until),
               std::max(last->criticality, loan.criticality),
               std::min(last->static_rank, loan.static_rank)};
        if (all.deadline == last->deadline && all.until == last->until) return false;
    }
    slot.lent_deadline_ns.store(all.deadline.count(), kRelaxed);
    slot.lent_criticality.store(static_cast<std::uint16_t>(all.criticality), kRelaxed);
    slot.lent_static_rank.store(static_cast<std::uint32_t>(all.static_rank), kRelaxed);
    slot.lent_until_ns.store(all.until.count(), std::memory_order_release);
    return true;
}

void apply_loan(SlotView& view, const LentDeadline& loan, nanoseconds due, nanoseconds now) {
    if (loan.deadline >= view.deadline) return;
    const nanoseconds due_laxity = laxity({loan.deadline, due, nanoseconds{0}}, now);
    if (due_laxity.count() < 0 && view.laxity.count() >= 0) return;
    view.deadline = loan.deadline;
    view.laxity = due_laxity;
    view.remaining_gpu = due;
    view.remaining_idle = view.later_idle = nanoseconds{0};
    view.remaining_cpu = view.later_cpu = view.later_gpu = nanoseconds{0};
    view.demoted = false;
    view.criticality = std::max(view.criticality, loan.criticality);
    view.static_rank = std::min(view.static_rank, loan.static_rank);
}

}  // namespace urgengo::model
