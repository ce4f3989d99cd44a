// SPDX-License-Identifier: Apache-2.0
//
// Calls that wait for the GPU, or ask whether it is done. Never held. Before a wait, what the
// thread launched last gets its mark, so that others see when it is done; a wait for all of it
// ends the task's GPU segment. If the config asks for it, the thread sleeps until the wait is
// nearly over (exec/cheap_waits.h); the program's own call has the last word.
#include <optional>

#include "interposer/boundary.h"
#include "interposer/manual/implicit_sync.h"
#include "interposer/own_time.h"
#include "interposer/real_driver.h"

using namespace urgengo::interposer;
using urgengo::abi::TraceWait;
using urgengo::exec::StreamFlavor;
using urgengo::runtime::ThreadState;
using urgengo::runtime::Wait;

namespace {

CallClass class_of(const Wait& wait) {
    return wait.function == TraceWait::kCopy ? CallClass::kCopy : CallClass::kSync;
}

// @param call  () -> CUresult: the program's own call
template <typename Call>
[[gnu::noinline]] CUresult waiting(Wait wait, Call&& call) {
    if (!acts_already()) return call();
    std::optional<GatesParked> parked;
    if (wait.function == TraceWait::kContext) parked.emplace();
    const OwnTime own_time(class_of(wait));
    ThreadState* thread = nullptr;
    const Inside inside;
    protect([&] {
        thread = this_thread();
        if (!thread) return;
        the_runtime().waits().before(*thread, wait);
        if (wait.function == TraceWait::kContext)
            the_runtime().waits().implicit_sync_begins(*thread);
        the_runtime().waits().sleep_through(*thread, wait);
    });
    const CUresult result = OwnTime::in_driver(call);
    if (thread)
        protect([&] {
            if (wait.function == TraceWait::kContext)
                the_runtime().waits().implicit_sync_ended(*thread);
            the_runtime().waits().after(*thread, wait, result == CUDA_SUCCESS);
        });
    return result;
}

// A question that is answered with no leaves everything as it was.
template <typename Call>
[[gnu::noinline]] CUresult asking(Wait wait, Call&& call) {
    if (!acts_already()) return call();
    const OwnTime own_time(class_of(wait));
    const Inside inside;
    const CUresult result = OwnTime::in_driver(call);
    if (result != CUDA_SUCCESS) return result;
    protect([&] {
        ThreadState* thread = this_thread();
        if (!thread) return;
        the_runtime().waits().before(*thread, wait);
        the_runtime().waits().after(*thread, wait, true);
    });
    return result;
}

Wait for_stream(TraceWait function, CUstream stream, StreamFlavor flavor) {
    Wait wait;
    wait.function = function;
    wait.stream = stream;
    wait.flavor = flavor;
    return wait;
}

Wait for_event(TraceWait function, CUevent event) {
    Wait wait;
    wait.function = function;
    wait.event = event;
    return wait;
}

Wait for_context() {
    Wait wait;
    wait.function = TraceWait::kContext;
    return wait;
}

// A copy to the host has come to its end when it returns, and so has what was before it on its
// stream; one to the GPU has not.
template <StreamFlavor flavor, typename Call>
CUresult copying_to_host(bool to_host, Call&& call) {
    if (!to_host) return call();
    return waiting(for_stream(TraceWait::kCopy, nullptr, flavor), call);
}

bool is_on_host(CUdeviceptr memory) {
    if (!acts_already() || !t_this.state) return false;
    const OwnTime own_time(CallClass::kCopy);
    const Inside inside;
    unsigned type = 0;
    return real().cuPointerGetAttribute(&type, CU_POINTER_ATTRIBUTE_MEMORY_TYPE, memory) !=
               CUDA_SUCCESS ||
           type == CU_MEMORYTYPE_HOST;
}

template <typename Copy>
bool goes_to_host(const Copy* copy) {
    return copy && copy->dstMemoryType == CU_MEMORYTYPE_HOST;
}

bool is_current(CUcontext context) {
    CUcontext current = nullptr;
    return !context || (real().cuCtxGetCurrent(&current) == CUDA_SUCCESS && current == context);
}

}  // namespace

// These names stand for others in cuda.h.
#undef cuMemcpy
#undef cuMemcpy2DUnaligned_v2
#undef cuMemcpy2D_v2
#undef cuMemcpy3D_v2
#undef cuMemcpyAtoH_v2
#undef cuMemcpyDtoH_v2
#undef cuStreamQuery
#undef cuStreamSynchronize

extern "C" {

CUresult CUDAAPI cuStreamSynchronize(CUstream stream) {
    if (const auto* driver = real_if_bystander_waits()) return driver->cuStreamSynchronize(stream);
    return waiting(for_stream(TraceWait::kStream, stream, StreamFlavor::kLegacy),
                   [&] { return real().cuStreamSynchronize(stream); });
}

CUresult CUDAAPI cuStreamSynchronize_ptsz(CUstream stream) {
    if (const auto* driver = real_if_bystander_waits())
        return driver->cuStreamSynchronize_ptsz(stream);
    return waiting(for_stream(TraceWait::kStream, stream, StreamFlavor::kPerThread),
                   [&] { return real().cuStreamSynchronize_ptsz(stream); });
}

CUresult CUDAAPI cuStreamQuery(CUstream stream) {
    if (const auto* driver = real_if_bystanders_event()) return driver->cuStreamQuery(stream);
    return asking(for_stream(TraceWait::kStreamQuery, stream, StreamFlavor::kLegacy),
                  [&] { return real().cuStreamQuery(stream); });
}

CUresult CUDAAPI cuStreamQuery_ptsz(CUstream stream) {
    if (const auto* driver = real_if_bystanders_event()) return driver->cuStreamQuery_ptsz(stream);
    return asking(for_stream(TraceWait::kStreamQuery, stream, StreamFlavor::kPerThread),
                  [&] { return real().cuStreamQuery_ptsz(stream); });
}

CUresult CUDAAPI cuCtxSynchronize() {
    if (const auto* driver = real_if_bystander_waits()) return driver->cuCtxSynchronize();
    return waiting(for_context(), [] { return real().cuCtxSynchronize(); });
}

CUresult CUDAAPI cuCtxSynchronize_v2(CUcontext context) {
    if (const auto* driver = real_if_bystander_waits()) return driver->cuCtxSynchronize_v2(context);
    const auto forward = [&] { return real().cuCtxSynchronize_v2(context); };
    if (!acts_already()) return forward();
    if (is_current(context)) return waiting(for_context(), forward);
    // What the thread launches in its own context is not waited for, but gates may be in that one.
    const GatesParked parked;
    return forward();
}

CUresult CUDAAPI cuEventSynchronize(CUevent event) {
    if (const auto* driver = real_if_bystander_waits()) return driver->cuEventSynchronize(event);
    return waiting(for_event(TraceWait::kEvent, event),
                   [&] { return real().cuEventSynchronize(event); });
}

CUresult CUDAAPI cuEventQuery(CUevent event) {
    if (const auto* driver = real_if_bystanders_event()) return driver->cuEventQuery(event);
    return asking(for_event(TraceWait::kEventQuery, event),
                  [&] { return real().cuEventQuery(event); });
}

CUresult CUDAAPI cuMemcpyDtoH_v2(void* h_destination, CUdeviceptr d_source, size_t bytes) {
    if (const auto* driver = real_if_bystander_waits())
        return driver->cuMemcpyDtoH_v2(h_destination, d_source, bytes);
    return copying_to_host<StreamFlavor::kLegacy>(
        true, [&] { return real().cuMemcpyDtoH_v2(h_destination, d_source, bytes); });
}

CUresult CUDAAPI cuMemcpyDtoH_v2_ptds(void* h_destination, CUdeviceptr d_source, size_t bytes) {
    if (const auto* driver = real_if_bystander_waits())
        return driver->cuMemcpyDtoH_v2_ptds(h_destination, d_source, bytes);
    return copying_to_host<StreamFlavor::kPerThread>(
        true, [&] { return real().cuMemcpyDtoH_v2_ptds(h_destination, d_source, bytes); });
}

CUresult CUDAAPI cuMemcpy(CUdeviceptr destination, CUdeviceptr source, size_t bytes) {
    if (const auto* driver = real_if_bystander_waits())
        return driver->cuMemcpy(destination, source, bytes);
    return copying_to_host<StreamFlavor::kLegacy>(
        is_on_host(destination), [&] { return real().cuMemcpy(destination, source, bytes); });
}

CUresult CUDAAPI cuMemcpy_ptds(CUdeviceptr destination, CUdeviceptr source, size_t bytes) {
    if (const auto* driver = real_if_bystander_waits())
        return driver->cuMemcpy_ptds(destination, source, bytes);
    return copying_to_host<StreamFlavor::kPerThread>(
        is_on_host(destination), [&] { return real().cuMemcpy_ptds(destination, source, bytes); });
}

CUresult CUDAAPI cuMemcpyAtoH_v2(void* h_destination, CUarray source, size_t offset, size_t bytes) {
    if (const auto* driver = real_if_bystander_waits())
        return driver->cuMemcpyAtoH_v2(h_destination, source, offset, bytes);
    return copying_to_host<StreamFlavor::kLegacy>(
        true, [&] { return real().cuMemcpyAtoH_v2(h_destination, source, offset, bytes); });
}

CUresult CUDAAPI cuMemcpyAtoH_v2_ptds(void* h_destination, CUarray source, size_t offset,
                                      size_t bytes) {
    if (const auto* driver = real_if_bystander_waits())
        return driver->cuMemcpyAtoH_v2_ptds(h_destination, source, offset, bytes);
    return copying_to_host<StreamFlavor::kPerThread>(
        true, [&] { return real().cuMemcpyAtoH_v2_ptds(h_destination, source, offset, bytes); });
}

CUresult CUDAAPI cuMemcpy2D_v2(const CUDA_MEMCPY2D* copy) {
    if (const auto* driver = real_if_bystander_waits()) return driver->cuMemcpy2D_v2(copy);
    return copying_to_host<StreamFlavor::kLegacy>(goes_to_host(copy),
                                                  [&] { return real().cuMemcpy2D_v2(copy); });
}

CUresult CUDAAPI cuMemcpy2D_v2_ptds(const CUDA_MEMCPY2D* copy) {
    if (const auto* driver = real_if_bystander_waits()) return driver->cuMemcpy2D_v2_ptds(copy);
    return copying_to_host<StreamFlavor::kPerThread>(
        goes_to_host(copy), [&] { return real().cuMemcpy2D_v2_ptds(copy); });
}

CUresult CUDAAPI cuMemcpy2DUnaligned_v2(const CUDA_MEMCPY2D* copy) {
    if (const auto* driver = real_if_bystander_waits()) return driver->cuMemcpy2DUnaligned_v2(copy);
    return copying_to_host<StreamFlavor::kLegacy>(
        goes_to_host(copy), [&] { return real().cuMemcpy2DUnaligned_v2(copy); });
}

CUresult CUDAAPI cuMemcpy2DUnaligned_v2_ptds(const CUDA_MEMCPY2D* copy) {
    if (const auto* driver = real_if_bystander_waits())
        return driver->cuMemcpy2DUnaligned_v2_ptds(copy);
    return copying_to_host<StreamFlavor::kPerThread>(
        goes_to_host(copy), [&] { return real().cuMemcpy2DUnaligned_v2_ptds(copy); });
}

CUresult CUDAAPI cuMemcpy3D_v2(const CUDA_MEMCPY3D* copy) {
    if (const auto* driver = real_if_bystander_waits()) return driver->cuMemcpy3D_v2(copy);
    return copying_to_host<StreamFlavor::kLegacy>(goes_to_host(copy),
                                                  [&] { return real().cuMemcpy3D_v2(copy); });
}

CUresult CUDAAPI cuMemcpy3D_v2_ptds(const CUDA_MEMCPY3D* copy) {
    if (const auto* driver = real_if_bystander_waits()) return driver->cuMemcpy3D_v2_ptds(copy);
    return copying_to_host<StreamFlavor::kPerThread>(
        goes_to_host(copy), [&] { return real().cuMemcpy3D_v2_ptds(copy); });
}

}  // extern "C"
