// SPDX-License-Identifier: Apache-2.0
#include "host/progress/recorded_events.h"

#include <algorithm>

#include "host/base/memory_orders.h"

namespace urgengo::progress {
namespace {

// Every field is stored after the odd version, and loaded before the second look at it.

}  // namespace

bool RecordedEvents::open(Entry& entry, const void* event) {
    std::uint32_t version = entry.version.load(kRelaxed);
    if (version % 2 != 0 ||
        !entry.version.compare_exchange_strong(version, version + 1, std::memory_order_acq_rel))
        return false;
    if (entry.event.load(kRelaxed) == event) return true;
    close(entry);
    return false;
}

void RecordedEvents::close(Entry& entry) {
    entry.version.store(entry.version.load(kRelaxed) + 1, kRelease);
}

// Where another thread is at the entry, it gives it to another event, or the program records this
// one twice at a time: any answer will do.
void RecordedEvents::recorded(const void* event, const RecordedEvent& record) {
    Set& set = sets_[set_of(event)];
    const auto is_its = [&](const Entry& e) { return e.event.load(kRelaxed) == event; };
    auto entry = std::find_if(set.begin(), set.end(), is_its);
    if (entry == set.end())
        entry = std::min_element(set.begin(), set.end(), [](const Entry& a, const Entry& b) {
            return a.serial.load(kRelaxed) < b.serial.load(kRelaxed);
        });
    if (!open(*entry, entry->event.load(kRelaxed))) return;
    const auto& on = record.covered.on;
    const bool is_forked = std::any_of(on.begin(), on.end(), [](auto n) { return n != 0; });
    entry->task.store(record.task, kRelease);
    entry->event.store(event, kRelease);
    entry->serial.store(next_serial_.fetch_add(1, kRelaxed), kRelease);
    entry->gpu_time_ns.store(record.gpu_time.count(), kRelease);
    entry->all.store(record.covered.all, kRelease);
    entry->is_forked.store(is_forked, kRelease);
    for (std::size_t i = 0; is_forked && i < on.size(); ++i) entry->on[i].store(on[i], kRelease);
    close(*entry);
}

void RecordedEvents::forget(const void* event) {
    for (Entry& entry : sets_[set_of(event)]) {
        if (entry.event.load(kRelaxed) != event || !open(entry, event)) continue;
        entry.event.store(nullptr, kRelease);
        entry.serial.store(0, kRelease);
        close(entry);
    }
}

std::optional<RecordedEvent> RecordedEvents::find(const void* event) const {
    if (!event) return std::nullopt;
    for (const Entry& entry : sets_[set_of(event)]) {
        const std::uint32_t version = entry.version.load(kAcquire);
        if (version % 2 != 0 || entry.event.load(kAcquire) != event) continue;
        RecordedEvent found;
        found.task = entry.task.load(kAcquire);
        found.gpu_time = nanoseconds(entry.gpu_time_ns.load(kAcquire));
        found.covered.all = entry.all.load(kAcquire);
        if (entry.is_forked.load(kAcquire))
            for (std::size_t i = 0; i < kMaxStreams; ++i)
                found.covered.on[i] = entry.on[i].load(kAcquire);
        if (entry.version.load(kRelaxed) == version) return found;
    }
    return std::nullopt;
}

}  // namespace urgengo::progress
