// SPDX-License-Identifier: Apache-2.0
//
// Unloading: handles of kernels that are gone come to mean others, so remembered names are dropped.
#include "interposer/manual/implicit_sync.h"
#include "interposer/real_driver.h"

using namespace urgengo::interposer;

namespace {

template <typename Unload>
CUresult unload_and_forget(Unload&& unload, bool with_streams = false) {
    const auto forget = [&] {
        if (!acts_already()) return;
        protect([&] {
            if (with_streams)
                the_runtime().context_destroyed();
            else
                the_runtime().forget_names();
        });
    };
    // Before, so that nobody finds an old name behind a handle that is used again at once; after,
    // so that nobody keeps one that was looked up meanwhile.
    forget();
    const CUresult result = waiting_for_all(unload);
    forget();
    return result;
}

}  // namespace

// These names stand for others in cuda.h.
#undef cuCtxDestroy
#undef cuDevicePrimaryCtxRelease
#undef cuDevicePrimaryCtxReset

extern "C" {

CUresult CUDAAPI cuModuleUnload(CUmodule module) {
    return unload_and_forget([&] { return real().cuModuleUnload(module); });
}

CUresult CUDAAPI cuLibraryUnload(CUlibrary library) {
    return unload_and_forget([&] { return real().cuLibraryUnload(library); });
}

// A context takes its modules and streams with it.

CUresult CUDAAPI cuCtxDestroy(CUcontext context) {
    return unload_and_forget([&] { return real().cuCtxDestroy_v1(context); }, true);
}

CUresult CUDAAPI cuCtxDestroy_v2(CUcontext context) {
    return unload_and_forget([&] { return real().cuCtxDestroy_v2(context); }, true);
}

// The last one of a device's takes its primary context along.
CUresult CUDAAPI cuGreenCtxDestroy(CUgreenCtx context) {
    return unload_and_forget([&] { return real().cuGreenCtxDestroy(context); }, true);
}

CUresult CUDAAPI cuDevicePrimaryCtxRelease(CUdevice device) {
    return unload_and_forget([&] { return real().cuDevicePrimaryCtxRelease_v1(device); }, true);
}

CUresult CUDAAPI cuDevicePrimaryCtxRelease_v2(CUdevice device) {
    return unload_and_forget([&] { return real().cuDevicePrimaryCtxRelease_v2(device); }, true);
}

CUresult CUDAAPI cuDevicePrimaryCtxReset(CUdevice device) {
    return unload_and_forget([&] { return real().cuDevicePrimaryCtxReset_v1(device); }, true);
}

CUresult CUDAAPI cuDevicePrimaryCtxReset_v2(CUdevice device) {
    return unload_and_forget([&] { return real().cuDevicePrimaryCtxReset_v2(device); }, true);
}

}  // extern "C"
