// SPDX-License-Identifier: Apache-2.0
//
// Calls that wait for all work of the context on their way. Never held; for as long as one takes,
// less urgent tasks launch nothing that could delay it (runtime/implicit_sync.cpp).
#pragma once

#include "interposer/boundary.h"
#include "interposer/own_time.h"

namespace urgengo::interposer {

/// @param call  () -> CUresult: the program's own
template <typename Call>
CUresult waiting_for_all(Call&& call) {
    if (!acts_already() || !t_this.state) return call();
    const OwnTime own_time(CallClass::kMemory);
    const Inside inside;
    protect([] { the_runtime().waits().implicit_sync_begins(*t_this.state); });
    const CUresult result = OwnTime::in_driver(call);
    protect([] { the_runtime().waits().implicit_sync_ended(*t_this.state); });
    return result;
}

}  // namespace urgengo::interposer
