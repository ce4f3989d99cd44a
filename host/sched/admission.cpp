// SPDX-License-Identifier: Apache-2.0
#include "host/sched/admission.h"

#include <array>

#include "host/sched/policy.h"

namespace urgengo::sched {

Decision decide(const config::Scheduler& scheduler, const Snapshot& snapshot) {
    std::array<Key, abi::kMaxTasks> storage;
    const std::span<Key> keys(storage.data(), snapshot.tasks.size());
    policy_keys(scheduler.policy, snapshot, keys);

    Decision d;
    d.utilization = snapshot.self().utilization;
    const bool exclusive = scheduler.admission == config::Admission::kExclusive;
    for (std::size_t i = 1; i < keys.size(); ++i) {
        const SlotView& other = snapshot.tasks[i];
        if (exclusive && other.blocking && other.launched.count() > 0) d.blocked = true;
        if (keys[i] > keys[0] || (keys[i] == keys[0] && other.task > snapshot.self().task))
            continue;
        ++d.rank;
        if (!other.blocking) continue;
        d.utilization += other.utilization;
        d.blocked = true;
    }
    if (scheduler.admission == config::Admission::kPacked)
        d.admit = !d.blocked || d.utilization <= scheduler.pack_limit;
    if (exclusive) d.admit = !d.blocked;
    return d;
}

}  // namespace urgengo::sched
