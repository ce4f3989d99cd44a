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
                the_runtime().waits().event_recorded(*thread, event, stream, flavor,
                                                     !g_untimed.contains(event));
        });
    return result;
}

// A thread that has never launched lets no task's work wait.
template <typename Wait>
[[gnu::noinline]] CUresult letting_wait(CUstream stream, CUevent event, StreamFlavor flavor,
                                        Wait&& wait) {
    if (!acts_already() || !t_this.state) return wait();
    const OwnTime own_time(CallClass::kEvent);
    const Inside inside;
    const CUresult result = OwnTime::in_driver(wait);
    if (result == CUDA_SUCCESS)
        protect([&] {
            the_runtime().work_on_streams().stream_waits(*t_this.state, stream, flavor, event);
        });
    return result;
}

CUresult destroying(CUevent event, CUresult(CUDAAPI* destroy)(CUevent)) {
    if (event) g_untimed.destroyed(event);
    if (event && is_armed())
        protect([&] { the_runtime().work_on_streams().event_destroyed(event); });
    return destroy(event);
}

template <typename Destroy>
CUresult destroying(CUstream stream, Destroy&& destroy) {
    if (!acts_already()) return destroy();
    const OwnTime own_time(CallClass::kOther);
    // Before: the handle may be given out again the moment it is free.
    bool captures = false;
    protect([&] { captures = the_runtime().work_on_streams().destroyed(stream); });
    const CUresult result = OwnTime::in_driver(destroy);
    if (captures && result == CUDA_SUCCESS)
        protect([&] { the_runtime().streams().capture_ended(stream, StreamFlavor::kLegacy); });
    return result;
}

}  // namespace

// These names stand for others in cuda.h.
#undef cuEventDestroy
#undef cuEventRecord
#undef cuEventRecordWithFlags
#undef cuStreamDestroy
#undef cuStreamWaitEvent

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
    if (const auto* driver = real_if_bystanders_event())
        return driver->cuEventRecord(event, stream);
    return recording(event, stream, StreamFlavor::kLegacy,
                     [&] { return real().cuEventRecord(event, stream); });
}

CUresult CUDAAPI cuEventRecord_ptsz(CUevent event, CUstream stream) {
    if (const auto* driver = real_if_bystanders_event())
        return driver->cuEventRecord_ptsz(event, stream);
    return recording(event, stream, StreamFlavor::kPerThread,
                     [&] { return real().cuEventRecord_ptsz(event, stream); });
}

CUresult CUDAAPI cuEventRecordWithFlags(CUevent event, CUstream stream, unsigned flags) {
    if (const auto* driver = real_if_bystanders_event())
        return driver->cuEventRecordWithFlags(event, stream, flags);
    return recording(event, stream, StreamFlavor::kLegacy,
                     [&] { return real().cuEventRecordWithFlags(event, stream, flags); });
}

CUresult CUDAAPI cuEventRecordWithFlags_ptsz(CUevent event, CUstream stream, unsigned flags) {
    if (const auto* driver = real_if_bystanders_event())
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

CUresult CUDAAPI cuStreamWaitEvent(CUstream stream, CUevent event, unsigned flags) {
    if (const auto* driver = real_if_bystanders_event())
        return driver->cuStreamWaitEvent(stream, event, flags);
    return letting_wait(stream, event, StreamFlavor::kLegacy,
                        [&] { return real().cuStreamWaitEvent(stream, event, flags); });
}

CUresult CUDAAPI cuStreamWaitEvent_ptsz(CUstream stream, CUevent event, unsigned flags) {
    if (const auto* driver = real_if_bystanders_event())
        return driver->cuStreamWaitEvent_ptsz(stream, event, flags);
    return letting_wait(stream, event, StreamFlavor::kPerThread,
                        [&] { return real().cuStreamWaitEvent_ptsz(stream, event, flags); });
}

}  // extern "C"
