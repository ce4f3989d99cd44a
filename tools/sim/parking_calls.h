// SPDX-License-Identifier: Apache-2.0
//
// A thread of no chain that frees memory now and then, say: each such call waits for all that is on
// the GPU when it begins, and no longer. Under UrgenGo gates are parked for as long as it takes
// (runtime/gate_keeper.h): the subject is told.
//
//   kAsleep --its time has come--> kWaiting --all has ended--> kSeeing --the host knows--> kAsleep
//
// What the call itself does to others (locks of the driver's, launches that wait for it) is left
// out: others launch meanwhile, as much as they want.
#pragma once

#include <cstdint>
#include <vector>

#include "tools/sim/gpu_model.h"
#include "tools/sim/subject.h"

namespace urgengo::sim {

class ParkingCalls {
  public:
    /// @param every  from one call's begin to the next one's, if it is over by then
    /// @param until  no call begins from then on
    /// Both models outlive it.
    ParkingCalls(nanoseconds every, nanoseconds until, const GpuModel& gpu, Subject& subject)
        : every_(every), until_(until), next_(every), gpu_(gpu), subject_(subject) {}

    /// @returns when it does something by itself; kNever: it waits for the GPU, or is done
    nanoseconds next() const;
    /// After the GPU's model has been brought to that time, and no further than next().
    void advance(nanoseconds now);

  private:
    enum class State { kAsleep, kWaiting, kSeeing };
    bool has_ended() const;

    const nanoseconds every_, until_;
    State state_ = State::kAsleep;
    nanoseconds next_;       ///< when it calls, or has seen the end
    nanoseconds called_{0};  ///< last
    const GpuModel& gpu_;
    Subject& subject_;
    std::vector<std::uint64_t> awaited_;  ///< by stream: launches
};

}  // namespace urgengo::sim
