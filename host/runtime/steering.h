// SPDX-License-Identifier: Apache-2.0
//
// The kill switch: what the control word (abi/status_page.h) asks for, done while the program runs,
// or hangs. It is obeyed by a thread of ours (interposer/control.h), which waits for no lock that
// the program's threads hold while they sleep or are in the driver.
//
//   off      Every hold and pacing ends at its next look, 2 ms later at most (sched/poll_budget.h);
//            all gates open. Launches pass from the mode's change on: no priority, no mark, no
//            count. Instances that are under way are ended where they are: what comes after `on`
//            is a new one.
//   observe  The same, but instances go on, and are counted.
//   shadow   What would be held, for how long and behind whom, is counted: it is decided as where
//            it is done, from marks, and nothing is held, nor launched at another priority.
//   on       What the process was started with.
//
//   reload   What can change while the program runs is taken from another config (reloading.h).
//
// Of all chains, or of one: then the others go on, and a launch of the chain's passes as one of no
// chain (off), or its instance is only looked at from its next launch on (observe), or only decided
// about (shadow: the others reckon with it as before). Such an instance stays so to its end. What
// was asked of one chain, and of all, holds until the same is asked again; the weaker one counts.
//
// Priorities that are lent to the program's streams are so for one call each, and go back with it;
// what the driver refused to take back is tried again last.
#pragma once

#include <atomic>
#include <cstdint>
#include <span>

#include "host/identity/instances.h"
#include "host/runtime/common.h"
#include "host/runtime/reloading.h"
#include "host/runtime/runs.h"

namespace urgengo::runtime {

class Steering {
  public:
    using Request = observe::StatusPage::Request;
    /// How long a hold may go on once it is to end: in the process' own time, as its machine may be
    /// busy, and it may be stopped.
    static constexpr nanoseconds kHoldsEnd{100'000'000};

    /// @param all of them  outlive it
    Steering(Common& common, Runs& runs, identity::Instances& instances, Reloading& reloading);

    /// Does what the word asks for, and what those before it do that were not seen. Says so in the
    /// status page once the holds that this ends have ended, or how many have not. A request that
    /// means nothing, or names no chain, is counted, and changes nothing.
    /// @threads one at a time
    void obey(std::uint32_t word);
    /// The same of requests that are known. @param requests  at least one, in their order
    void obey(std::span<const Request> requests);
    /// UrgenGo has switched itself to that, for good: no word changes it. @threads any
    void never_again(config::Mode mode) {
        for_good_.store(mode);
        set_mode(mode);
    }

    /// Nothing is held or changed any more, or again. @threads any
    void set_mode(config::Mode mode);

  private:
    abi::ControlResult obey_one(const Request& request);
    abi::ControlResult reload(std::uint32_t word);
    void steer_all(config::Mode mode);
    void steer(std::size_t chain, config::Mode mode);
    void changed();
    std::uint32_t holds_left() const;
    void leave_instances();
    void leave_instances(const ChainState& chain);

    Common& common_;
    Runs& runs_;
    identity::Instances& instances_;
    Reloading& reloading_;
    config::Mode first_;                                          ///< the config's
    std::uint32_t seen_ = 0;                                      ///< the last word
    std::atomic<config::Mode> for_good_{config::Mode::kEnforce};  ///< that: nothing is
};

}  // namespace urgengo::runtime
