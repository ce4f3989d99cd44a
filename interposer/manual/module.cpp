// SPDX-License-Identifier: Apache-2.0
//
// Loading: waits for all work of the context (measured, H200: cuModuleLoadData, and
// cuKernelGetFunction of a kernel that is not loaded yet; cuLibraryLoadData does not).
// Unloading: handles of kernels that are gone come to mean others, so remembered names are dropped.
#include "interposer/manual/implicit_sync.h"
#include "interposer/real_driver.h"

using namespace urgengo::interposer;
using urgengo::exec::EndingContext;
using urgengo::identity::NameGate;

namespace {

/// @param load  () -> CUresult: the program's own
template <typename Load>
CUresult loading(Load&& load) {
    const GatesParked parked;
    return load();
}

template <typename Unload>
CUresult unload_and_forget(Unload&& unload, const EndingContext* ending = nullptr) {
    // Before, so that no thread finds an old name behind a handle that is used again at once;
    // after, so that no thread keeps one that was looked up meanwhile.
    if (acts_already())
        protect([&] {
            ending ? the_runtime().contexts().ends(*ending)
                   : the_runtime().contexts().forget_names();
        });
    NameGate* const gate = acts_already() ? &the_runtime().kernels().gate() : nullptr;
    const CUresult result = waiting_for_all([&] {
        const NameGate::Unloading unloading(gate);
        return unload();
    });
    if (acts_already())
        protect([&] {
            ending ? the_runtime().contexts().ended(*ending)
                   : the_runtime().contexts().forget_names();
        });
    return result;
}

template <typename End>
CUresult end_context(const EndingContext& ending, End&& end) {
    const CUresult result = unload_and_forget(end, &ending);
    // Another one may be current now.
    if (t_this.state && !t_this.line.inside) t_this.state->line.ask_again();
    return result;
}

}  // namespace

// These names stand for others in cuda.h.
#undef cuCtxDestroy
#undef cuDevicePrimaryCtxRelease
#undef cuDevicePrimaryCtxReset

extern "C" {

CUresult CUDAAPI cuModuleLoad(CUmodule* module, const char* path) {
    return loading([&] { return real().cuModuleLoad(module, path); });
}

CUresult CUDAAPI cuModuleLoadData(CUmodule* module, const void* image) {
    return loading([&] { return real().cuModuleLoadData(module, image); });
}

CUresult CUDAAPI cuModuleLoadDataEx(CUmodule* module, const void* image, unsigned count,
                                    CUjit_option* options, void** values) {
    return loading(
        [&] { return real().cuModuleLoadDataEx(module, image, count, options, values); });
}

CUresult CUDAAPI cuModuleLoadFatBinary(CUmodule* module, const void* image) {
    return loading([&] { return real().cuModuleLoadFatBinary(module, image); });
}

CUresult CUDAAPI cuKernelGetFunction(CUfunction* function, CUkernel kernel) {
    return loading([&] { return real().cuKernelGetFunction(function, kernel); });
}

CUresult CUDAAPI cuModuleUnload(CUmodule module) {
    return unload_and_forget([&] { return real().cuModuleUnload(module); });
}

CUresult CUDAAPI cuLibraryUnload(CUlibrary library) {
    return unload_and_forget([&] { return real().cuLibraryUnload(library); });
}

// A context takes its modules and streams with it.

CUresult CUDAAPI cuCtxDestroy(CUcontext context) {
    return end_context({context, -1}, [&] { return real().cuCtxDestroy_v1(context); });
}

CUresult CUDAAPI cuCtxDestroy_v2(CUcontext context) {
    return end_context({context, -1}, [&] { return real().cuCtxDestroy_v2(context); });
}

// If it was the last to be attached.
CUresult CUDAAPI cuCtxDetach(CUcontext context) {
    return end_context({context, -1}, [&] { return real().cuCtxDetach(context); });
}

// The last one of a device's takes its primary context along.
CUresult CUDAAPI cuGreenCtxDestroy(CUgreenCtx context) {
    return end_context({}, [&] { return real().cuGreenCtxDestroy(context); });
}

CUresult CUDAAPI cuDevicePrimaryCtxRelease(CUdevice device) {
    return end_context({nullptr, device},
                       [&] { return real().cuDevicePrimaryCtxRelease_v1(device); });
}

CUresult CUDAAPI cuDevicePrimaryCtxRelease_v2(CUdevice device) {
    return end_context({nullptr, device},
                       [&] { return real().cuDevicePrimaryCtxRelease_v2(device); });
}

CUresult CUDAAPI cuDevicePrimaryCtxReset(CUdevice device) {
    return end_context({nullptr, device},
                       [&] { return real().cuDevicePrimaryCtxReset_v1(device); });
}

CUresult CUDAAPI cuDevicePrimaryCtxReset_v2(CUdevice device) {
    return end_context({nullptr, device},
                       [&] { return real().cuDevicePrimaryCtxReset_v2(device); });
}

}  // extern "C"
