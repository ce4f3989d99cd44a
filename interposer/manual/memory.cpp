// SPDX-License-Identifier: Apache-2.0
//
// Memory calls that wait for all work of the context on their way, and cuCtxSetLimit, which does so
// too (measured, H200, of the first four). Arrays are freed as other memory is, and to unmap some
// is to take it from whatever runs: where they do not wait, they are over before it matters.
#include "interposer/manual/implicit_sync.h"
#include "interposer/real_driver.h"

using namespace urgengo::interposer;

extern "C" {

CUresult CUDAAPI cuMemFree_v2(CUdeviceptr d_memory) {
    if (const auto* driver = real_if_bystanders_event()) return driver->cuMemFree_v2(d_memory);
    return waiting_for_all([&] { return real().cuMemFree_v2(d_memory); });
}

CUresult CUDAAPI cuMemFreeHost(void* memory) {
    if (const auto* driver = real_if_bystanders_event()) return driver->cuMemFreeHost(memory);
    return waiting_for_all([&] { return real().cuMemFreeHost(memory); });
}

CUresult CUDAAPI cuMemHostUnregister(void* memory) {
    if (const auto* driver = real_if_bystanders_event()) return driver->cuMemHostUnregister(memory);
    return waiting_for_all([&] { return real().cuMemHostUnregister(memory); });
}

CUresult CUDAAPI cuMemUnmap(CUdeviceptr d_memory, size_t bytes) {
    if (const auto* driver = real_if_bystanders_event()) return driver->cuMemUnmap(d_memory, bytes);
    return waiting_for_all([&] { return real().cuMemUnmap(d_memory, bytes); });
}

CUresult CUDAAPI cuArrayDestroy(CUarray array) {
    if (const auto* driver = real_if_bystanders_event()) return driver->cuArrayDestroy(array);
    return waiting_for_all([&] { return real().cuArrayDestroy(array); });
}

CUresult CUDAAPI cuMipmappedArrayDestroy(CUmipmappedArray array) {
    if (const auto* driver = real_if_bystanders_event())
        return driver->cuMipmappedArrayDestroy(array);
    return waiting_for_all([&] { return real().cuMipmappedArrayDestroy(array); });
}

CUresult CUDAAPI cuCtxSetLimit(CUlimit limit, size_t value) {
    if (const auto* driver = real_if_bystanders_event()) return driver->cuCtxSetLimit(limit, value);
    return waiting_for_all([&] { return real().cuCtxSetLimit(limit, value); });
}

}  // extern "C"
