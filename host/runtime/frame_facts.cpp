// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/frame_facts.h"

#include "host/base/memory_orders.h"

namespace urgengo::runtime {

void GpuWindows::begin(nanoseconds arrival, nanoseconds deadline, nanoseconds launched,
                       nanoseconds now) {
    const std::uint32_t count = count_.load(kRelaxed);
    Entry& entry = ring_[count % kRing];
    entry.arrival.store(arrival.count(), kRelaxed);
    entry.deadline.store(deadline.count(), kRelaxed);
    entry.begin.store(now.count(), kRelaxed);
    entry.end.store(0, kRelaxed);
    entry.first_work.store(launched.count(), kRelaxed);
    entry.last_work.store(launched.count(), kRelaxed);
    entry.is_executed.store(false, kRelaxed);
    entry.alone.store(0, kRelaxed);
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

void GpuWindows::end(nanoseconds launched, bool is_executed, nanoseconds alone, nanoseconds now) {
    const std::uint32_t count = count_.load(kRelaxed);
    if (count == 0) return;
    Entry& entry = ring_[(count - 1) % kRing];
    if (entry.end.load(kRelaxed) != 0) return;
    entry.last_work.store(launched.count(), kRelaxed);
    entry.is_executed.store(is_executed, kRelaxed);
    entry.alone.store(alone.count(), kRelaxed);
    entry.end.store(now.count(), kRelaxed);
}

GpuWindows::Segment GpuWindows::read(const Entry& entry) {
    return {nanoseconds(entry.arrival.load(kRelaxed)),
            nanoseconds(entry.deadline.load(kRelaxed)),
            nanoseconds(entry.begin.load(kRelaxed)),
            nanoseconds(entry.end.load(kRelaxed)),
            nanoseconds(entry.first_work.load(kRelaxed)),
            nanoseconds(entry.last_work.load(kRelaxed)),
            entry.is_executed.load(kRelaxed),
            nanoseconds(entry.alone.load(kRelaxed)),
            entry.first_priority.load(kRelaxed),
            entry.last_priority.load(kRelaxed)};
}

void HoldSpans::add(const Hold& hold) {
    const std::uint32_t count = count_.load(kRelaxed);
    if (count > 0) {
        Entry& last = ring_[(count - 1) % kRing];
        if (last.arrival.load(kRelaxed) == hold.arrival.count() &&
            last.behind.load(kRelaxed) == hold.behind &&
            last.end.load(kRelaxed) == hold.begin.count())
            return last.end.store(hold.end.count(), kRelaxed);
    }
    Entry& entry = ring_[count % kRing];
    entry.arrival.store(hold.arrival.count(), kRelaxed);
    entry.begin.store(hold.begin.count(), kRelaxed);
    entry.end.store(hold.end.count(), kRelaxed);
    entry.behind.store(hold.behind, kRelaxed);
    count_.store(count + 1, std::memory_order_release);
}

HoldSpans::Hold HoldSpans::read(const Entry& entry) {
    return {nanoseconds(entry.arrival.load(kRelaxed)), nanoseconds(entry.begin.load(kRelaxed)),
            nanoseconds(entry.end.load(kRelaxed)), entry.behind.load(kRelaxed)};
}

}  // namespace urgengo::runtime
