// SPDX-License-Identifier: Apache-2.0
//
// What NVTX calls in the library that NVTX_INJECTION64_PATH names, at the program's first NVTX
// call.
#include "interposer/lifecycle.h"
#include "interposer/nvtx_tool.h"

using namespace urgengo::interposer;

/// @returns 1 if we attached. A program that has no call to schedule yet is not started for it.
extern "C" __attribute__((visibility("default"))) int InitializeInjectionNvtx2(NvtxTables tables) {
    if (g_every_call.state.load(std::memory_order_acquire) == State::kOff) return 0;
    return attach_to_nvtx(tables) ? 1 : 0;
}
