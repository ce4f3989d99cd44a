// SPDX-License-Identifier: Apache-2.0
//
// Memory calls that wait for all work of the context on their way, and cuCtxSetLimit, which does so
// too (measured, H200).
#include "interposer/manual/implicit_sync.h"
#include "interposer/real_driver.h"

using namespace urgengo::interposer;

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

CUresult CUDAAPI cuCtxSetLimit(CUlimit limit, size_t value) {
    if (const auto* driver = real_if_nobodys_event()) return driver->cuCtxSetLimit(limit, value);
    return waiting_for_all([&] { return real().cuCtxSetLimit(limit, value); });
}

}  // extern "C"
