// SPDX-License-Identifier: Apache-2.0
//
// What NVTX calls in the library that NVTX_INJECTION64_PATH names, at the program's first NVTX
// call, and at its first one of each extension.
#include "interposer/lifecycle.h"
#include "interposer/nvtx_behind.h"
#include "interposer/nvtx_tool.h"

using namespace urgengo::interposer;

extern "C" {

/// @returns 1 if we attached, or the tool behind us did. A program that has no call to schedule yet
/// is not started for it.
__attribute__((visibility("default"))) int InitializeInjectionNvtx2(NvtxTables tables) {
    const NvtxToolBehind& behind = nvtx_tool_behind();
    if (g_every_call.state.load(std::memory_order_acquire) == State::kOff)
        return behind.initialize ? behind.initialize(tables) : 0;
    return attach_to_nvtx(tables, behind.initialize) ? 1 : 0;
}

/// Extensions are the tool's behind us alone: it fills the program's own tables.
/// @returns as NVTX would have it without us: 1 if there is a tool that has no extensions, 0 if
/// there is no tool. One that refused the core would be given domains of ours.
__attribute__((visibility("default"))) int InitializeInjectionNvtxExtension(void* module_info) {
    const NvtxToolBehind& behind = nvtx_tool_behind();
    if (!behind.initialize || nvtx_tool_has_refused()) return 0;
    return behind.initialize_extension ? behind.initialize_extension(module_info) : 1;
}

}  // extern "C"
