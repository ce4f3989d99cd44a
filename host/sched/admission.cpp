// SPDX-License-Identifier: Apache-2.0
#include "host/sched/admission.h"

#include <algorithm>
#include <array>

#include "host/sched/contender.h"
#include "host/sched/policy.h"

namespace urgengo::sched {
namespace {

using config::Admission;

/// Whether holding others can still be of use to it; to one that is demoted all come before.
bool may_be_met(const SlotView& v, const Snapshot& snapshot) {
    return can_be_met(v, snapshot.plan.given_up.contains(v.task)) || snapshot.self().state.demoted;
}

/// Whether both would launch later, and the two together no sooner, than one after the other. That
/// holds for late tasks, too: the launches of neither are lost.
bool slow_each_other(const SlotView& self, const SlotView& other) {
    return self.launching.slowed == model::Launching::kSlowed && other.launching.is_next &&
           model::may_need_same_lock(other.launching.slowed);
}

void admit_packed(const config::Scheduler& scheduler, const Snapshot& snapshot,
                  const Contender& self, const Before& before, Decision& d) {
    if (d.launches_late) {
        d.admit = d.is_free = false;
        return;
    }
    const auto others = snapshot.tasks.subspan(1);
    const bool drains = std::any_of(others.begin(), others.end(),
                                    [](const SlotView& v) { return v.state.needs_all; });
    const bool may_share = snapshot.plan.may_share.contains(self.task);
    d.is_free = is_free(self, before);
    d.admit =
        fits(self, before, limits_of(scheduler.packing, snapshot.plan).now(may_share, drains));
}

bool admit_threshold(const config::Scheduler& scheduler, const Snapshot& snapshot,
                     const Decision& decision) {
    if (decision.urgent || snapshot.self().utilization < scheduler.parameters.exempt_utilization)
        return true;
    const auto others = snapshot.tasks.subspan(1);
    return std::none_of(others.begin(), others.end(), [&](const SlotView& other) {
        return other.state.blocking && is_urgent(other, snapshot);
    });
}

int bucket(const SlotView& v, const Snapshot& snapshot) {
    return bucket_of(v.chain.static_rank, snapshot.num_chains, snapshot.num_levels);
}

bool admit_buckets(const Snapshot& snapshot, const Order& order) {
    const SlotView& self = snapshot.self();
    const int own = bucket(self, snapshot);
    if (self.state.started || own == 0) return true;
    for (std::size_t i = 1; i < snapshot.tasks.size(); ++i) {
        const SlotView& other = snapshot.tasks[i];
        if (!other.state.blocking || bucket(other, snapshot) != own) continue;
        if (other.state.started || order.is_before_self(i)) return false;
    }
    return true;
}

// The largest that is left opens a group, and takes along what still fits beside it, largest first.
bool admit_groups(const config::Scheduler& scheduler, const Snapshot& snapshot) {
    constexpr double kWhole = 1;
    std::array<std::uint8_t, abi::kMaxTasks> order;
    std::size_t n = 0;
    for (std::size_t i = 0; i < snapshot.tasks.size(); ++i)
        if (i == 0 || snapshot.tasks[i].state.blocking) order[n++] = static_cast<std::uint8_t>(i);
    const auto size = [&](std::uint8_t i) { return snapshot.tasks[i].mean_utilization; };
    std::sort(order.begin(), order.begin() + n, [&](auto a, auto b) {
        return size(a) != size(b) ? size(a) > size(b)
                                  : snapshot.tasks[a].task < snapshot.tasks[b].task;
    });
    std::array<bool, abi::kMaxTasks> grouped{};
    std::int64_t num_groups = 0, own_group = 0;
    for (std::size_t first = 0; first < n; ++first) {
        if (grouped[first]) continue;
        double sum = 0;
        for (std::size_t i = first; i < n; ++i) {
            if (grouped[i] || (i != first && sum + size(order[i]) > kWhole)) continue;
            grouped[i] = true;
            sum += size(order[i]);
            if (order[i] == 0) own_group = num_groups;
        }
        ++num_groups;
    }
    return snapshot.now / scheduler.parameters.quantum % num_groups == own_group;
}

/// Of those for which `blocks` holds, the first in order; 0: there is none.
template <typename Blocks>
std::size_t first_of(const Snapshot& snapshot, const Order& order, Blocks&& blocks) {
    std::size_t first = 0;
    for (std::size_t i = 1; i < snapshot.tasks.size(); ++i)
        if (blocks(i) && (first == 0 || order.is_before(i, first))) first = i;
    return first;
}

/// Of a launch that is not admitted: why, and which task it waits for.
void explain(const config::Scheduler& scheduler, const Snapshot& snapshot, const Order& order,
             Decision& d) {
    const SlotView& self = snapshot.self();
    const auto view = [&](std::size_t i) -> const SlotView& { return snapshot.tasks[i]; };
    const auto blocks_by_rank = [&](std::size_t i) {
        return view(i).state.blocking && may_be_met(view(i), snapshot) && order.is_before_self(i);
    };
    std::size_t first = 0;
    if (d.launches_late) {
        d.why = Why::kTurnToLaunch;
        first = first_of(snapshot, order, [&](std::size_t i) {
            return slow_each_other(self, view(i)) && order.is_before_self(i);
        });
        d.blocker = first == 0 ? -1 : view(first).task;
        return;
    }
    switch (scheduler.admission) {
        case Admission::kNone:
            return;
        case Admission::kPacked:
            first = first_of(snapshot, order, blocks_by_rank);
            d.why = first != 0 && view(first).state.needs_all ? Why::kDrain : Why::kRank;
            break;
        case Admission::kThreshold:
            d.why = Why::kThreshold;
            first = first_of(snapshot, order, [&](std::size_t i) {
                return view(i).state.blocking && is_urgent(view(i), snapshot);
            });
            break;
        case Admission::kExclusive:
            d.why = Why::kExclusive;
            first = first_of(snapshot, order, [&](std::size_t i) {
                return view(i).ahead.launched.count() > 0 || blocks_by_rank(i);
            });
            break;
        case Admission::kBuckets:
            d.why = Why::kBucket;
            first = first_of(snapshot, order, [&](std::size_t i) {
                return view(i).state.blocking &&
                       bucket(view(i), snapshot) == bucket(self, snapshot) &&
                       (view(i).state.started || order.is_before_self(i));
            });
            break;
        case Admission::kGroups:
            d.why = Why::kGroup;
            break;
    }
    d.blocker = first == 0 ? -1 : view(first).task;
}

}  // namespace

TaskSet passed_over(const config::Scheduler& scheduler, const Snapshot& snapshot) {
    const Order order(scheduler, snapshot);
    TaskSet slots;
    for (std::size_t i = 1; i < snapshot.tasks.size(); ++i) {
        const SlotView& other = snapshot.tasks[i];
        if (other.state.overdue && !other.state.blocking && order.is_before_self(i))
            slots.insert(other.task);
    }
    return slots;
}

Decision behind_all(const SlotView& self) {
    return {
        .rank = abi::kMaxTasks, .utilization = self.utilization, .num_tasks = 1, .is_free = false};
}

Decision decide(const config::Scheduler& scheduler, const Snapshot& snapshot) {
    const Order order(scheduler, snapshot);
    Decision d;
    d.key = order.own();
    Contender self{.task = snapshot.self().task,
                   .demoted = snapshot.self().state.demoted,
                   .own = load_of(snapshot.self(), snapshot.self().next)};
    Before before;
    d.num_tasks = static_cast<int>(snapshot.tasks.size());
    d.urgent = is_urgent(snapshot.self(), snapshot);
    bool others_work = false;
    int launchers = 0, pausing = 0;
    for (std::size_t i = 1; i < snapshot.tasks.size(); ++i) {
        const SlotView& other = snapshot.tasks[i];
        others_work |= other.ahead.launched.count() > 0;
        if (!order.is_before_self(i)) continue;
        ++d.rank;
        d.before.insert(other.task);
        launchers += slow_each_other(snapshot.self(), other);
        pausing += other.launching.pauses && model::may_need_same_lock(other.launching.slowed);
        if (!other.state.blocking) continue;
        const bool counts = may_be_met(other, snapshot);
        before = before + Before{counts ? load_of(other, other.ahead.launched) : 0, counts, 1};
    }
    d.utilization = to_utilization(before.load + self.own);
    d.blocked = before.blockers > 0;
    if (scheduler.packing.launchers > 0 &&
        (scheduler.admission == Admission::kPacked || snapshot.takes_turns)) {
        d.launches_late = launchers >= scheduler.packing.launchers;
        d.blocked |= d.launches_late;
        d.others_pause = !d.launches_late && launchers + pausing >= scheduler.packing.launchers;
    }
    switch (scheduler.admission) {
        case Admission::kNone:
            d.admit = !d.launches_late;
            if (snapshot.takes_turns) d.is_free = d.admit && before.blockers == 0;
            break;
        case Admission::kPacked:
            admit_packed(scheduler, snapshot, self, before, d);
            break;
        case Admission::kThreshold:
            d.admit = admit_threshold(scheduler, snapshot, d);
            break;
        case Admission::kExclusive:
            d.blocked |= others_work;
            d.admit = !d.blocked;
            break;
        case Admission::kBuckets:
            d.admit = admit_buckets(snapshot, order);
            break;
        case Admission::kGroups:
            d.admit = admit_groups(scheduler, snapshot);
            break;
    }
    if (!d.admit) explain(scheduler, snapshot, order, d);
    return d;
}

}  // namespace urgengo::sched
