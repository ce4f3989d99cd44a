// SPDX-License-Identifier: Apache-2.0
//
// cuGetProcAddress: the other door to the driver. The real driver answers; when its answer is a
// function that it exports, ours of that name is given instead, so that both doors lead to the same
// function, as they do in the driver. Never by the name asked for: one name stands for several
// functions, by version and flags. And a function that we do not know at all is looked at by its
// name: it may begin a capture (unknown_captures.h).
#include "interposer/real_driver.h"
#include "interposer/unknown_captures.h"

// cuda.h lets this name stand for the second version.
#undef cuGetProcAddress

using namespace urgengo::interposer;

namespace {

void* to_give(void* function, const char* symbol, cuuint64_t flags) {
    void* const ours = ours_for(function);
    return ours != function ? ours : noting_captures(function, symbol, flags);
}

}  // namespace

extern "C" {

CUresult CUDAAPI cuGetProcAddress(const char* symbol, void** function, int cuda_version,
                                  cuuint64_t flags) {
    const CUresult result = real().cuGetProcAddress_v1(symbol, function, cuda_version, flags);
    if (result == CUDA_SUCCESS && function && *function)
        *function = to_give(*function, symbol, flags);
    return result;
}

CUresult CUDAAPI cuGetProcAddress_v2(const char* symbol, void** function, int cuda_version,
                                     cuuint64_t flags, CUdriverProcAddressQueryResult* status) {
    const CUresult result =
        real().cuGetProcAddress_v2(symbol, function, cuda_version, flags, status);
    if (result == CUDA_SUCCESS && function && *function)
        *function = to_give(*function, symbol, flags);
    return result;
}

}  // extern "C"
