// SPDX-License-Identifier: Apache-2.0
#include "host/exec/arms.h"

#include <algorithm>

#include "host/base/memory_orders.h"

namespace urgengo::exec {
namespace {

std::uint32_t ended_of(const abi::DispatchLease& page) {
    return __atomic_load_n(&page.ended, __ATOMIC_ACQUIRE);
}

/// Numbers go round.
bool is_later(std::uint32_t a, std::uint32_t b) {
    return static_cast<std::int32_t>(a - b) > 0;
}
std::uint32_t later_of(std::uint32_t a, std::uint32_t b) {
    return is_later(a, b) ? a : b;
}
std::uint32_t up_to(std::uint32_t last, std::uint32_t from) {
    return is_later(last, from) ? last - from : 0;
}

}  // namespace

std::uint32_t Arms::waiting(const abi::DispatchLease& page, std::uint32_t last) const {
    return up_to(last, later_of(ended_of(page), ticked_.load(kAcquire)));
}

bool Arms::is_due(const abi::DispatchLease& page, std::uint32_t last, std::uint32_t wanted) const {
    return waiting(page, last) < wanted && up_to(last, ended_of(page)) < kMostUnderWay;
}

// What the host has ticked was not woken: it says nothing of how many are needed.
std::uint32_t Arms::wanted(const abi::DispatchLease& page, std::uint32_t last) {
    const std::uint32_t ended = ended_of(page), ticked = ticked_.load(kAcquire);
    const std::uint32_t woken = up_to(ended, later_of(wanted_.ended, ticked));
    if (ticked != wanted_.ticked)
        wanted_.ahead = kFewest;
    else if (woken >= wanted_.ahead / 2 && !is_later(ended, last))
        wanted_.ahead = std::min(2 * wanted_.ahead, kMost);
    wanted_.ended = ended;
    wanted_.ticked = ticked;
    return wanted_.ahead;
}

void Arms::tick_through(abi::DispatchLease& page, std::uint32_t last) {
    const std::uint32_t ended = ended_of(page);
    for (std::uint32_t n = up_to(last, ended); n > 0; --n)
        __atomic_store_n(&page.ticks[(last - n + 1) % abi::kArmRing], last - n + 1,
                         __ATOMIC_SEQ_CST);
    ticked_.store(last, kRelease);
}

bool Arms::look(abi::DispatchLease& page, std::uint32_t last, nanoseconds now,
                nanoseconds longest) {
    // What has not ended by then never does: its context is gone or broken.
    constexpr nanoseconds kLongestEnd{1'000'000'000};
    const std::uint32_t ended = ended_of(page);
    const bool has_ended = !is_later(last, ended);
    if (has_ended || ended != seen_.ended || last != seen_.last) seen_ = {last, ended, now};
    if (has_ended) return false;
    const nanoseconds unchanged = now - seen_.since;
    if (unchanged >= longest) tick_through(page, last);
    return unchanged < longest + kLongestEnd;
}

}  // namespace urgengo::exec
