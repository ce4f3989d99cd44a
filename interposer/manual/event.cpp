// SPDX-License-Identifier: Apache-2.0
//
// Events and streams as far as they tell whose work is where: an event recorded behind everything
// that a thread has launched makes a wait for it a wait for everything. And which events take the
// time: between two of those, around one launch, the program measures. Never held, never changed.
#include "host/exec/untimed_events.h"
#include "interposer/boundary.h"
#include "interposer/own_time.h"
#include "interposer/real_driver.h"

using namespace urgengo::interposer;
using urgengo::exec::StreamFlavor;

namespace {

// From the program's first event on: many are made before the launch that starts UrgenGo.
constinit urgengo::exec::UntimedEvents g_untimed;

template <typename Record>
[[gnu::noinline]] CUresult recording(CUevent event, CUstream stream, StreamFlavor flavor,
                                     Record&& record) {
    if (!acts_already()) return record();
    const OwnTime own_time(CallClass::kEvent);
    const Inside inside;
    const CUresult result = OwnTime::in_driver(record);
    if (result == CUDA_SUCCESS)
        protect([&] {
            if (auto* thread = this_thread())
                the_runtime().event_recorded(*thread, event, stream, flavor,
                                             !g_untimed.contains(event));
        });
    return result;
}

CUresult destroying(CUevent event, CUresult(CUDAAPI* destroy)(CUevent)) {
    if (event) g_untimed.destroyed(event);
    return destroy(event);
}

template <typename Destroy>
CUresult destroying(CUstream stream, Destroy&& destroy) {
    if (!acts_already()) return destroy();
    const OwnTime own_time(CallClass::kOther);
    // Before: the handle may be given out again the moment it is free.
    bool captures = false;
    protect([&] { captures = the_runtime().stream_destroyed(stream); });
    const CUresult result = OwnTime::in_driver(destroy);
    if (captures && result == CUDA_SUCCESS)
        protect([&] { the_runtime().capture_ended(stream, StreamFlavor::kLegacy); });
    return result;
}

}  // namespace

// These names stand for others in cuda.h.
#undef cuEventDestroy
#undef cuEventRecord
#undef cuEventRecordWithFlags
#undef cuStreamDestroy

extern "C" {

CUresult CUDAAPI cuEventCreate(CUevent* event, unsigned flags) {
    const CUresult result = real().cuEventCreate(event, flags);
    if (result == CUDA_SUCCESS) g_untimed.created(*event, flags);
    return result;
}

CUresult CUDAAPI cuEventDestroy(CUevent event) {
    return destroying(event, real().cuEventDestroy_v1);
}

CUresult CUDAAPI cuEventDestroy_v2(CUevent event) {
    return destroying(event, real().cuEventDestroy_v2);
}

CUresult CUDAAPI cuEventRecord(CUevent event, CUstream stream) {
    if (const auto* driver = real_if_nobodys_event()) return driver->cuEventRecord(event, stream);
    return recording(event, stream, StreamFlavor::kLegacy,
                     [&] { return real().cuEventRecord(event, stream); });
}

CUresult CUDAAPI cuEventRecord_ptsz(CUevent event, CUstream stream) {
    if (const auto* driver = real_if_nobodys_event())
        return driver->cuEventRecord_ptsz(event, stream);
    return recording(event, stream, StreamFlavor::kPerThread,
                     [&] { return real().cuEventRecord_ptsz(event, stream); });
}

CUresult CUDAAPI cuEventRecordWithFlags(CUevent event, CUstream stream, unsigned flags) {
    if (const auto* driver = real_if_nobodys_event())
        return driver->cuEventRecordWithFlags(event, stream, flags);
    return recording(event, stream, StreamFlavor::kLegacy,
                     [&] { return real().cuEventRecordWithFlags(event, stream, flags); });
}

CUresult CUDAAPI cuEventRecordWithFlags_ptsz(CUevent event, CUstream stream, unsigned flags) {
    if (const auto* driver = real_if_nobodys_event())
        return driver->cuEventRecordWithFlags_ptsz(event, stream, flags);
    return recording(event, stream, StreamFlavor::kPerThread,
                     [&] { return real().cuEventRecordWithFlags_ptsz(event, stream, flags); });
}

CUresult CUDAAPI cuStreamDestroy(CUstream stream) {
    return destroying(stream, [&] { return real().cuStreamDestroy_v1(stream); });
}

CUresult CUDAAPI cuStreamDestroy_v2(CUstream stream) {
    return destroying(stream, [&] { return real().cuStreamDestroy_v2(stream); });
}

}  // extern "C"
