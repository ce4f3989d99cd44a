// SPDX-License-Identifier: Apache-2.0
//
// Frees that wait for all work of the context on their way. Never held; for as long as one takes,
// less urgent tasks launch nothing that could delay it (runtime/implicit_sync.cpp).
#include "interposer/boundary.h"
#include "interposer/real_driver.h"

using namespace urgengo::interposer;

namespace {

template <typename Call>
CUresult waiting_for_all(Call&& call) {
    if (!acts_already() || !t_state) return call();
    const Inside inside;
    protect([] { the_runtime().implicit_sync_begins(*t_state); });
    const CUresult result = call();
    protect([] { the_runtime().implicit_sync_ended(*t_state); });
    return result;
}

}  // namespace

extern "C" {

CUresult CUDAAPI cuMemFree_v2(CUdeviceptr d_memory) {
    if (const auto* driver = real_if_nobodys_event()) return driver->cuMemFree_v2(d_memory);
    return waiting_for_all([&] { return real().cuMemFree_v2(d_memory); });
}

CUresult CUDAAPI cuMemFreeHost(void* memory) {
    if (const auto* driver = real_if_nobodys_event()) return driver->cuMemFreeHost(memory);
    return waiting_for_all([&] { return real().cuMemFreeHost(memory); });
}

CUresult CUDAAPI cuMemHostUnregister(void* memory) {
    if (const auto* driver = real_if_nobodys_event()) return driver->cuMemHostUnregister(memory);
    return waiting_for_all([&] { return real().cuMemHostUnregister(memory); });
}

}  // extern "C"
