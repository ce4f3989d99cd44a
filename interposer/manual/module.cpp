// SPDX-License-Identifier: Apache-2.0
//
// Unloading: handles of kernels that are gone come to mean others, so remembered names are dropped.
#include "interposer/boundary.h"
#include "interposer/real_driver.h"

using namespace urgengo::interposer;

namespace {

template <typename Unload>
CUresult unload_and_forget(Unload&& unload) {
    const auto forget = [] {
        if (acts_already()) protect([] { the_runtime().forget_names(); });
    };
    // Before, so that nobody finds an old name behind a handle that is used again at once; after,
    // so that nobody keeps one that was looked up meanwhile.
    forget();
    const CUresult result = unload();
    forget();
    return result;
}

}  // namespace

extern "C" {

CUresult CUDAAPI cuModuleUnload(CUmodule module) {
    return unload_and_forget([&] { return real().cuModuleUnload(module); });
}

CUresult CUDAAPI cuLibraryUnload(CUlibrary library) {
    return unload_and_forget([&] { return real().cuLibraryUnload(library); });
}

}  // extern "C"
