// SPDX-License-Identifier: Apache-2.0
//
// Waits that do not spin (`cpu: {blocking_sync: on}`): before the program's own call, which would,
// the thread sleeps and asks now and then whether what it waits for is over.
//
// Not by blocking events: they wake the thread 120 to 580 us late, where asking every 20 us is 19
// us late (medians over a 2 ms kernel, H200 in a virtual machine, driver 580.159.04, 2026-11-21).
// Asking costs 17 % of a core at 20 us and 5 % at 100 us, so long waits are slept through first:
// for most of what the progress marks say is left.
#pragma once

#include "host/base/clock.h"
#include "host/exec/captures.h"
#include "host/sched/governor.h"

namespace urgengo::exec {

class CheapWaits {
  public:
    /// What the program waits for.
    struct Goal {
        CUstream stream = nullptr;
        StreamFlavor flavor = StreamFlavor::kLegacy;
        CUevent event = nullptr;  ///< null: the stream
    };

    /// @param wanted  the config asks for them
    /// All others outlive it.
    CheapWaits(bool wanted, const DriverApi& driver, Clock& clock, const Captures& captures,
               sched::Governor& governor)
        : wanted_(wanted),
          driver_(driver),
          clock_(clock),
          captures_(captures),
          governor_(governor) {}

    bool are_on() const { return wanted_ && governor_.steered().enforces(); }
    /// Sleeps until that is (nearly) over. Not while something is captured.
    /// @param task     it is a wait for all that this one has launched; null: not known for what
    /// @threads any; while they are on
    void sleep_until_over(const Goal& goal, sched::GovernedTask* task) const;

  private:
    CUresult ask_whether_over(const Goal& goal) const;

    const bool wanted_;
    const DriverApi& driver_;
    Clock& clock_;
    const Captures& captures_;
    sched::Governor& governor_;
};

}  // namespace urgengo::exec
