// SPDX-License-Identifier: Apache-2.0
//
// cuGetProcAddress: the other door to the driver. The real driver answers; when its answer is a
// function that it exports, ours of that name is given instead, so that both doors lead to the same
// function, as they do in the driver. Never by the name asked for: one name stands for several
// functions, by version and flags.
#include "interposer/real_driver.h"

// cuda.h lets this name stand for the second version.
#undef cuGetProcAddress

using namespace urgengo::interposer;

extern "C" {

CUresult CUDAAPI cuGetProcAddress(const char* symbol, void** function, int cuda_version,
                                  cuuint64_t flags) {
    const CUresult result = real().cuGetProcAddress_v1(symbol, function, cuda_version, flags);
    if (result == CUDA_SUCCESS && function && *function) *function = ours_for(*function);
    return result;
}

CUresult CUDAAPI cuGetProcAddress_v2(const char* symbol, void** function, int cuda_version,
                                     cuuint64_t flags, CUdriverProcAddressQueryResult* status) {
    const CUresult result =
        real().cuGetProcAddress_v2(symbol, function, cuda_version, flags, status);
    if (result == CUDA_SUCCESS && function && *function) *function = ours_for(*function);
    return result;
}

}  // extern "C"
