// SPDX-License-Identifier: Apache-2.0
#include "host/exec/published_copies.h"

#include <algorithm>

#include "host/base/memory_orders.h"
#include "host/sched/copies.h"

namespace urgengo::exec {
bool PublishedCopies::Entry::should_run(nanoseconds now) const {
    return now.count() < submitted_ns.load(kAcquire) + time_ns.load(kAcquire);
}

bool PublishedCopies::Entry::is_within_bound(nanoseconds now, nanoseconds since) const {
    return now - since < sched::copy_bound(nanoseconds(time_ns.load(kAcquire)));
}

bool PublishedCopies::Entry::may_be_at_engine(nanoseconds now) const {
    const std::uint64_t v = version.load(kAcquire);
    if (v == 0 || v == over.load(kAcquire)) return false;
    if (should_run(now)) return true;
    if (!end.load(kAcquire)) return false;
    const nanoseconds reached_at(reached_ns.load(kAcquire));
    return reached_at.count() == 0 || is_within_bound(now, reached_at);
}

PublishedCopies::Entry* PublishedCopies::oldest_since(std::uint64_t& version) {
    Entry* oldest = nullptr;
    std::uint64_t its = 0;
    for (Entry& entry : entries_) {
        const std::uint64_t v = entry.version.load(kAcquire);
        if (v <= version || v == entry.over.load(kAcquire) || (oldest && v > its)) continue;
        oldest = &entry;
        its = v;
    }
    version = its;
    return oldest;
}

void PublishedCopies::comes(nanoseconds until) {
    comes_until_ns_.store(until.count(), kRelease);
}

PublishedCopies::Ticket PublishedCopies::submitted(const Place& place, const Events& events,
                                                   nanoseconds now, nanoseconds time) {
    Entry& entry = entries_[place.index];
    // Nothing of what follows is seen with a version that was there before take_place().
    if (!place.is_shared || entry.context.load(kRelaxed) != events.context) {
        entry.reached.store(place.is_shared ? nullptr : events.reached, kRelease);
        entry.reached_ns.store(entry.reached.load(kRelaxed) ? 0 : now.count(), kRelease);
    } else if (entry.reached_ns.load(kRelaxed) != 0) {
        entry.reached_ns.store(now.count(), kRelease);
    }
    entry.submitted_ns.store(now.count(), kRelease);
    entry.time_ns.store(time.count(), kRelease);
    entry.context.store(events.context, kRelease);
    entry.end.store(events.end, kRelease);
    entry.version.store(++last_version_, kRelease);
    newest_ = place.index;
    nothing_came();
    return {place.index, last_version_};
}

void PublishedCopies::seen(CUevent end) {
    for (Entry& entry : entries_)
        if (entry.end.load(kRelaxed) == end)
            entry.over.store(entry.version.load(kRelaxed), kRelease);
}

void PublishedCopies::over(const Ticket& ticket, bool and_before) {
    for (Entry& entry : entries_) {
        const std::uint64_t version = entry.version.load(kAcquire);
        if (version == ticket.version || (and_before && version < ticket.version))
            entry.over.store(version, kRelease);
    }
}

bool PublishedCopies::may_be_any(nanoseconds now) const {
    return comes_until_ns_.load(kAcquire) > now.count() ||
           std::any_of(entries_.begin(), entries_.end(),
                       [&](const Entry& entry) { return entry.may_be_at_engine(now); });
}

}  // namespace urgengo::exec
