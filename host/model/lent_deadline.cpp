// SPDX-License-Identifier: Apache-2.0
#include "host/model/lent_deadline.h"

#include "host/base/memory_orders.h"

namespace urgengo::model {
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

}  // namespace urgengo::model
