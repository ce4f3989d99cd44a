// SPDX-License-Identifier: Apache-2.0
//
// Of an armed dispatcher: how many arms are to wait in its stream, and which of them the host
// ticks.
//
// An arm is {wait for its tick, rank kernel} (abi::DispatchLease). No SM is held while it waits,
// but whatever waits for all work of the context waits for it, and for those behind it. So arms are
// ticked through, which costs each a kernel of 3 us that does nothing:
//   1 before calls that wait for all work (park), and none is put there until those are over;
//   2 once nothing has happened to any for as long as a lease: no gate is in use any more, or what
//     all wait for stands behind an arm, in a call that was not known to wait or in a hardware
//     channel that two streams share.
// Few wait at first, more where marks wake them faster than they are put there: a call of 1 waits
// for what is there.
//
// Ticking is a store to the host's memory, so that no lock of the driver's can be in its way.
#pragma once

#include <atomic>
#include <cstdint>

#include "host/base/clock.h"
#include "urgengo/abi/dispatcher.h"

namespace urgengo::exec {

class Arms {
  public:
    static constexpr std::uint32_t kFewest = 4, kMost = 32;
    /// With those that were ticked, but have not ended.
    static constexpr std::uint32_t kMostUnderWay = 2 * kMost;
    static_assert(kMostUnderWay <= abi::kArmRing / 2);

    /// That many are to wait. @param last  number of the last one that there is
    /// @threads one at a time
    std::uint32_t wanted(const abi::DispatchLease& page, std::uint32_t last);
    /// @returns whether one more may be put behind the last, so that `wanted` wait
    /// @threads any
    bool is_due(const abi::DispatchLease& page, std::uint32_t last, std::uint32_t wanted) const;

    /// All up to this one go through, whatever the GPU does. @threads any
    void tick_through(abi::DispatchLease& page, std::uint32_t last);
    /// The same of what has waited for too long. @returns whether one may still be there
    /// @threads one at a time
    bool look(abi::DispatchLease& page, std::uint32_t last, nanoseconds now, nanoseconds longest);

  private:
    std::uint32_t waiting(const abi::DispatchLease& page, std::uint32_t last) const;

    std::atomic<std::uint32_t> ticked_{0};  // the last one that the host has ticked
    struct {
        std::uint32_t ahead = kFewest, ended = 0, ticked = 0;
    } wanted_;  // at the last wanted()
    struct {
        std::uint32_t last = 0, ended = 0;
        nanoseconds since{0};
    } seen_;  // by the last look()
};

}  // namespace urgengo::exec
