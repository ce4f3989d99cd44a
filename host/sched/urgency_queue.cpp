// SPDX-License-Identifier: Apache-2.0
#include "host/sched/urgency_queue.h"

#include <algorithm>

namespace urgengo::sched {

void UrgencyQueue::stands(const QueuedLaunch& launch) {
    abi::TaskSlot& slot = page_.tasks[launch.task];
    if (slot.queue_why.load(kRelaxed) == Why::kNone)
        slot.queue_since_ns.store(launch.since.count(), kRelaxed);
    // Mostly it waits as it did: the line is not taken from those that read it.
    const auto set = [](auto& field, auto value, std::memory_order order) {
        if (field.load(kRelaxed) != value) field.store(value, order);
    };
    set(slot.queue_key, launch.key, kRelaxed);
    set(slot.queue_behind, launch.behind, kRelaxed);
    set(slot.queue_why, launch.why, std::memory_order_release);
}

void UrgencyQueue::leaves(int task) {
    abi::TaskSlot& slot = page_.tasks[task];
    if (slot.queue_why.load(kRelaxed) != Why::kNone)
        slot.queue_why.store(Why::kNone, std::memory_order_release);
}

QueuedLaunch UrgencyQueue::read_entry(const abi::TaskSlot& slot, int task) {
    return {.task = task,
            .why = slot.queue_why.load(std::memory_order_acquire),
            .behind = slot.queue_behind.load(kRelaxed),
            .since = nanoseconds(slot.queue_since_ns.load(kRelaxed)),
            .key = slot.queue_key.load(kRelaxed)};
}

template <typename Act>
void UrgencyQueue::for_each(Act&& act) const {
    for (int word = 0; word < abi::kTaskWords; ++word)
        for (std::uint64_t bits = page_.active[word].load(kRelaxed); bits != 0; bits &= bits - 1) {
            const int task = 64 * word + __builtin_ctzll(bits);
            const QueuedLaunch launch = read_entry(page_.tasks[task], task);
            if (launch.why != Why::kNone) act(launch);
        }
}

int UrgencyQueue::place(int task, Key key) const {
    const QueuedLaunch own{.task = task, .key = key};
    int before = 0;
    for_each([&](const QueuedLaunch& launch) {
        before += launch.task != task && launch.why != Why::kRunAhead && launch.is_before(own);
    });
    return before;
}

std::size_t UrgencyQueue::read(std::span<QueuedLaunch> launches) const {
    std::size_t count = 0;
    for_each([&](const QueuedLaunch& launch) {
        if (count < launches.size()) launches[count++] = launch;
    });
    std::sort(launches.begin(), launches.begin() + static_cast<std::ptrdiff_t>(count),
              [](const QueuedLaunch& a, const QueuedLaunch& b) { return a.is_before(b); });
    return count;
}

}  // namespace urgengo::sched
