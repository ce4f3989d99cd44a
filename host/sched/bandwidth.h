// SPDX-License-Identifier: Apache-2.0
//
// Bandwidth: a chain whose frames come more often than its period says is served as if they came
// when they were due.
//
// 1 Deadlines order the chains. A chain that runs back to back always has the earliest one: each of
//   its frames arrives as the last one ends, so it takes the whole GPU, whatever period its config
//   gives it. (A constant-bandwidth server: Abeni and Buttazzo, RTSS 1998.)
// 2 So a frame that comes early counts its deadline, for the order, from when it was due: a period
//   after the frame before it was. Until then it comes after all that can be in time, among those
//   that are late: so a chain that is late once can catch up (model/slot_view.cpp). Whether a frame
//   is late is told by its true arrival, as ever.
// 3 Frames jitter, and periods are configured roundly: half a period early, and for good an eighth
//   more often than configured, is not early. And no frame is put off by more than kMostPeriods: a
//   config whose period is wrong makes its chain less urgent, but not for ever.
//
// Written by the thread that tells of a frame, mostly one at a time: a race puts one frame off by a
// little too much or too little. Takes no lock.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>

namespace urgengo::sched {

using std::chrono::nanoseconds;

class Bandwidth {
  public:
    static constexpr int kMostPeriods = 2;

    /// A frame has arrived.
    /// @returns by how much it is put off
    nanoseconds arrived(nanoseconds arrival, nanoseconds period) {
        const nanoseconds tolerance = period / 2;
        const nanoseconds due = std::min(std::max(arrival, nanoseconds(due_ns_.load(kRelaxed))),
                                         arrival + tolerance + kMostPeriods * period);
        const nanoseconds put_off = std::max(due - arrival - tolerance, nanoseconds{0});
        due_ns_.store((due + period - period / 8).count(), kRelaxed);
        Frame& frame = last_[count_.fetch_add(1, kRelaxed) % last_.size()];
        frame.arrival_ns.store(arrival.count(), kRelaxed);
        frame.put_off_ns.store(put_off.count(), kRelaxed);
        return put_off;
    }

    /// @returns when the frame that arrived then counts as having arrived, for the order
    nanoseconds served(nanoseconds arrival) const {
        for (const Frame& frame : last_)
            if (frame.arrival_ns.load(kRelaxed) == arrival.count())
                return arrival + nanoseconds(frame.put_off_ns.load(kRelaxed));
        return arrival;
    }

  private:
    static constexpr auto kRelaxed = std::memory_order_relaxed;
    struct Frame {
        std::atomic<std::int64_t> arrival_ns{0}, put_off_ns{0};
    };
    std::atomic<std::int64_t> due_ns_{0};
    std::atomic<std::uint32_t> count_{0};
    std::array<Frame, 8> last_;  ///< a chain's tasks begin a frame one after the other
};

}  // namespace urgengo::sched
