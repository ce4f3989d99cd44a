// SPDX-License-Identifier: Apache-2.0
//
// Unloading: handles of kernels that are gone come to mean others, so remembered names are dropped.
#include "interposer/boundary.h"
#include "interposer/real_driver.h"

using namespace urgengo::interposer;

extern "C" {

CUresult CUDAAPI cuModuleUnload(CUmodule module) {
    const CUresult result = real().cuModuleUnload(module);
    if (acts_already()) protect([] { the_runtime().forget_names(); });
    return result;
}

CUresult CUDAAPI cuLibraryUnload(CUlibrary library) {
    const CUresult result = real().cuLibraryUnload(library);
    if (acts_already()) protect([] { the_runtime().forget_names(); });
    return result;
}

}  // extern "C"
