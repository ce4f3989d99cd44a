// SPDX-License-Identifier: Apache-2.0
//
// Calls that wait for all work of the context on their way. Never held; for as long as one takes,
// less urgent tasks launch nothing that could delay it (runtime/implicit_sync.cpp).
#pragma once

#include "interposer/boundary.h"
#include "interposer/own_time.h"

namespace urgengo::interposer {

/// No gate is closed (runtime/gate_keeper.h) for as long as the object lives, however that ends.
class GatesParked {
  public:
    GatesParked() {
        if (!acts_already() || !the_runtime().gate_keeper().are_on()) return;
        const Inside inside;  // another NVTX tool that is told may call the driver
        protect([this] {
            the_runtime().gate_keeper().park();
            parked_ = true;
        });
    }
    ~GatesParked() {
        if (parked_) protect([] { the_runtime().gate_keeper().unpark(); });
    }
    GatesParked(const GatesParked&) = delete;
    GatesParked& operator=(const GatesParked&) = delete;

  private:
    bool parked_ = false;
};

/// @param call  () -> CUresult: the program's own
template <typename Call>
CUresult waiting_for_all(Call&& call) {
    if (!acts_already()) return call();
    const GatesParked parked;
    if (!t_this.state) return call();
    const OwnTime own_time(CallClass::kMemory);
    const Inside inside;
    protect([] { the_runtime().waits().implicit_sync_begins(*t_this.state); });
    const CUresult result = OwnTime::in_driver(call);
    protect([] { the_runtime().waits().implicit_sync_ended(*t_this.state); });
    return result;
}

}  // namespace urgengo::interposer
