// SPDX-License-Identifier: Apache-2.0
//
// Calls that wait for the GPU. Never held. Before the wait, what the thread launched last gets its
// mark, so that others see when it is done; a wait for the whole stream ends the task's GPU
// segment.
#include "interposer/boundary.h"
#include "interposer/real_driver.h"

using namespace urgengo::interposer;
using urgengo::exec::StreamFlavor;
using urgengo::runtime::Runtime;
using urgengo::runtime::ThreadState;

namespace {

// @param mark      (ThreadState&): marks what was launched before
// @param for_task  (ThreadState&) -> bool: does this call wait for all that the task launched?
template <typename Mark, typename ForTask, typename Wait>
CUresult waiting(Mark&& mark, ForTask&& for_task, Wait&& wait) {
    if (!acts_already()) return wait();
    ThreadState* thread = nullptr;
    bool all = false;
    const Inside inside;
    protect([&] {
        thread = this_thread();
        if (!thread) return;
        all = for_task(*thread);
        mark(*thread);
    });
    const CUresult result = wait();
    if (thread) protect([&] { the_runtime().after_wait(*thread, all && result == CUDA_SUCCESS); });
    return result;
}

template <typename Wait>
[[gnu::noinline]] CUresult waiting_for_stream(CUstream stream, StreamFlavor flavor, Wait&& wait) {
    return waiting([&](ThreadState& t) { the_runtime().before_wait(t, stream, flavor); },
                   [&](ThreadState& t) { return Runtime::waits_for_task(t, stream, flavor); },
                   wait);
}

// Waits that name no stream: nothing can be marked, the stream of the last launch may be gone.
template <typename Wait>
CUresult waiting_for_other(bool for_task, Wait&& wait) {
    return waiting([](ThreadState&) {}, [&](ThreadState&) { return for_task; }, wait);
}

bool is_current(CUcontext context) {
    CUcontext current = nullptr;
    return !context || (real().cuCtxGetCurrent(&current) == CUDA_SUCCESS && current == context);
}

}  // namespace

// These names stand for others in cuda.h.
#undef cuMemcpyDtoH_v2
#undef cuStreamSynchronize

extern "C" {

CUresult CUDAAPI cuStreamSynchronize(CUstream stream) {
    if (const auto* driver = real_if_off()) return driver->cuStreamSynchronize(stream);
    return waiting_for_stream(stream, StreamFlavor::kLegacy,
                              [&] { return real().cuStreamSynchronize(stream); });
}

CUresult CUDAAPI cuStreamSynchronize_ptsz(CUstream stream) {
    if (const auto* driver = real_if_off()) return driver->cuStreamSynchronize_ptsz(stream);
    return waiting_for_stream(stream, StreamFlavor::kPerThread,
                              [&] { return real().cuStreamSynchronize_ptsz(stream); });
}

CUresult CUDAAPI cuCtxSynchronize() {
    return waiting_for_other(true, [] { return real().cuCtxSynchronize(); });
}

CUresult CUDAAPI cuCtxSynchronize_v2(CUcontext context) {
    return waiting_for_other(acts_already() && is_current(context),
                             [&] { return real().cuCtxSynchronize_v2(context); });
}

CUresult CUDAAPI cuEventSynchronize(CUevent event) {
    return waiting_for_other(false, [&] { return real().cuEventSynchronize(event); });
}

CUresult CUDAAPI cuMemcpyDtoH_v2(void* h_destination, CUdeviceptr d_source, size_t bytes) {
    return waiting_for_stream(nullptr, StreamFlavor::kLegacy, [&] {
        return real().cuMemcpyDtoH_v2(h_destination, d_source, bytes);
    });
}

CUresult CUDAAPI cuMemcpyDtoH_v2_ptds(void* h_destination, CUdeviceptr d_source, size_t bytes) {
    return waiting_for_stream(nullptr, StreamFlavor::kPerThread, [&] {
        return real().cuMemcpyDtoH_v2_ptds(h_destination, d_source, bytes);
    });
}

}  // extern "C"
