// SPDX-License-Identifier: Apache-2.0
//
// A thread that belongs to no chain and fills the GPU now and then, as urgengo-chains'
// (tools/chains/bystander.h): a kernel of waves of 0.2 ms whose blocks take every thread slot, then
// a wait for it, then a sleep.
#pragma once

#include "tools/sim/chain_model.h"

namespace urgengo::sim {

struct BystanderSettings {
    nanoseconds length{0};  ///< of its kernels, alone; 0: there is none
    nanoseconds period{10'000'000};
};

class BystanderModel {
  public:
    /// @param until  it launches nothing from then on
    BystanderModel(const BystanderSettings& settings, int thread, nanoseconds until,
                   ChainSurroundings& surroundings, Subject& subject);
    void go_on(nanoseconds now);

  private:
    enum class State { kLaunching, kAsleep, kWaiting };
    void waited(nanoseconds now);

    const BystanderSettings settings_;
    const int thread_;
    const nanoseconds until_;
    ChainSurroundings& surroundings_;
    Subject& subject_;
    KernelWork kernel_;
    State state_ = State::kLaunching;
    nanoseconds next_{0};
};

}  // namespace urgengo::sim
