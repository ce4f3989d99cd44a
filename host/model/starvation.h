// SPDX-License-Identifier: Apache-2.0
//
// Starvation: when an instance that gave way to others gives way no more.
//
// 1 What was launched at a low priority stays behind all that others launch, and a late instance
//   comes after those in time. So in overload an instance may give way for ever.
// 2 An instance *gives way* while its launch is held for others, and while work of its that the GPU
//   should have executed is not (beyond twice its estimate and a millisecond). That is what
//   scheduling did to it; that it came late by itself, or computes for long, is not.
// 3 From kStarvedDeadlines late on, once it has given way for kGaveWayDeadlines, it comes before
//   all others: for at most one deadline, or kShortestTurn. Then it has to give way again, for
//   twice as long as it had, before its next turn. So it cannot put all others behind it for ever:
//   an instance has at most a third of the time.
//
// The state lies in the slot, so each reader of a slot applies the rule. Two readers may race: one
// of them begins the turn. Pure; takes no lock.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>

#include "urgengo/abi/shared_page.h"

namespace urgengo::model {

using std::chrono::nanoseconds;

/// An instance that is late by more than so many deadlines is late enough.
inline constexpr int kStarvedDeadlines = 4;
/// And has given way for so many.
inline constexpr int kGaveWayDeadlines = 2;
/// A turn is no shorter than this, however short the deadline is.
inline constexpr nanoseconds kShortestTurn{10'000'000};

/// The instance has given way for so long.
inline void gave_way(abi::TaskSlot& slot, nanoseconds time) {
    if (time.count() > 0) slot.gave_way_ns.fetch_add(time.count(), std::memory_order_relaxed);
}

/// An instance begins.
inline void forget_starvation(abi::TaskSlot& slot) {
    slot.gave_way_ns.store(0, std::memory_order_relaxed);
    slot.turn_at_ns.store(0, std::memory_order_relaxed);
    slot.turn_until_ns.store(0, std::memory_order_relaxed);
}

/// @param deadline           t_arr + D
/// @param relative_deadline  D; 0: of no chain's deadline, and never starved
/// @param waits              for which its work on the GPU has been overdue, as of now
/// @returns whether it comes before all others now
inline bool is_starved(abi::TaskSlot& slot, nanoseconds deadline, nanoseconds relative_deadline,
                       nanoseconds waits, nanoseconds now) {
    if (relative_deadline.count() <= 0 || now - deadline <= kStarvedDeadlines * relative_deadline)
        return false;
    if (now.count() < slot.turn_until_ns.load(std::memory_order_relaxed)) return true;
    const std::int64_t gave_way_ns =
        slot.gave_way_ns.load(std::memory_order_relaxed) + std::max(waits, nanoseconds{0}).count();
    std::int64_t last_ns = slot.turn_at_ns.load(std::memory_order_relaxed);
    const std::int64_t next_ns =
        last_ns > 0 ? 2 * last_ns : (kGaveWayDeadlines * relative_deadline).count();
    if (gave_way_ns < next_ns) return false;
    if (slot.turn_at_ns.compare_exchange_strong(last_ns, gave_way_ns, std::memory_order_relaxed))
        slot.turn_until_ns.store((now + std::max(relative_deadline, kShortestTurn)).count(),
                                 std::memory_order_relaxed);
    return true;
}

}  // namespace urgengo::model
