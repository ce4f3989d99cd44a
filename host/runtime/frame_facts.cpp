// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/frame_facts.h"

#include "host/base/memory_orders.h"

namespace urgengo::runtime {

void GpuWindows::begin(nanoseconds arrival, nanoseconds deadline, nanoseconds now) {
    const std::uint32_t count = count_.load(kRelaxed);
    Entry& entry = ring_[count % kRing];
    entry.arrival.store(arrival.count(), kRelaxed);
    entry.deadline.store(deadline.count(), kRelaxed);
    entry.begin.store(now.count(), kRelaxed);
    entry.end.store(0, kRelaxed);
    entry.gpu.store(0, kRelaxed);
    entry.first_priority.store(kNone, kRelaxed);
    entry.last_priority.store(-kNone, kRelaxed);
    count_.store(count + 1, std::memory_order_release);
}

void GpuWindows::launches_at(int priority) {
    const std::uint32_t count = count_.load(kRelaxed);
    if (count == 0) return;
    Entry& entry = ring_[(count - 1) % kRing];
    if (priority < entry.first_priority.load(kRelaxed))
        entry.first_priority.store(priority, kRelaxed);
    if (priority > entry.last_priority.load(kRelaxed))
        entry.last_priority.store(priority, kRelaxed);
}

void GpuWindows::end(nanoseconds now, nanoseconds gpu) {
    const std::uint32_t count = count_.load(kRelaxed);
    if (count == 0) return;
    Entry& entry = ring_[(count - 1) % kRing];
    if (entry.end.load(kRelaxed) != 0) return;
    entry.gpu.store(gpu.count(), kRelaxed);
    entry.end.store(now.count(), kRelaxed);
}

GpuWindows::Segment GpuWindows::read(const Entry& entry) {
    return {nanoseconds(entry.arrival.load(kRelaxed)), nanoseconds(entry.deadline.load(kRelaxed)),
            nanoseconds(entry.begin.load(kRelaxed)),   nanoseconds(entry.end.load(kRelaxed)),
            nanoseconds(entry.gpu.load(kRelaxed)),     entry.first_priority.load(kRelaxed),
            entry.last_priority.load(kRelaxed)};
}

}  // namespace urgengo::runtime
