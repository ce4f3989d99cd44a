// SPDX-License-Identifier: Apache-2.0
//
// Which events were made without timing. Between two events that do take the time, around one
// launch, the program measures: then nothing of ours may come between (an autotuner would choose
// another kernel). The driver cannot be asked for an event's flags.
//
// Any thread, no lock. A place that two handles share remembers the younger one: an event that is
// not remembered counts as one that takes the time, which is the careful answer.
#pragma once

#include <cuda.h>

#include <array>
#include <atomic>
#include <cstdint>

namespace urgengo::exec {

class UntimedEvents {
  public:
    void created(CUevent event, unsigned flags) {
        auto& place = at(event);
        if (flags & CU_EVENT_DISABLE_TIMING)
            place.store(event, std::memory_order_relaxed);
        else if (place.load(std::memory_order_relaxed) == event)
            place.store(nullptr, std::memory_order_relaxed);
    }
    /// Before it is destroyed: its handle may come to mean another event.
    void destroyed(CUevent event) { created(event, 0); }

    bool contains(CUevent event) const {
        return event && at(event).load(std::memory_order_relaxed) == event;
    }

  private:
    static constexpr int kBits = 14;
    using Place = std::atomic<CUevent>;

    Place& at(CUevent event) { return places_[slot(event)]; }
    const Place& at(CUevent event) const { return places_[slot(event)]; }
    static std::size_t slot(CUevent event) {
        return (reinterpret_cast<std::uint64_t>(event) * 0x9e3779b97f4a7c15u) >> (64 - kBits);
    }

    std::array<Place, std::size_t{1} << kBits> places_{};
};

}  // namespace urgengo::exec
