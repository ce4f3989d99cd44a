// SPDX-License-Identifier: Apache-2.0
//
// Tables of callbacks as NVTX has them in a program, for a tool to fill: our own (nvtx_link.h).
// Only for files that may see NVTX's types.
#pragma once

// Types only: the implementation is for programs.
#ifndef NVTX_NO_IMPL
#define NVTX_NO_IMPL
#endif
#include <nvtx3/nvToolsExtCounters.h>
#include <nvtx3/nvToolsExtPayload.h>

#include <cstddef>
#include <cstdint>

#include "host/observe/nvtx_link.h"

namespace urgengo::observe {

// One module's callbacks, and NVTX's table of where they are; without the first, which is none.
template <std::size_t kSize>
struct NvtxModule {
    NvtxFunctionPointer functions[kSize] = {};
    NvtxFunctionPointer* table[kSize + 1] = {};
    NvtxModule() {
        for (std::size_t i = 1; i < kSize; ++i) table[i] = &functions[i];
    }
};

struct NvtxSlots {
    static constexpr std::size_t kNumSlots = 63;  ///< as in NVTX's own modules

    NvtxModule<NVTX_CBID_CORE_SIZE> core;
    NvtxModule<NVTX_CBID_CORE2_SIZE> core2;
    NvtxModule<NVTX_CBID_CUDA_SIZE> cuda;
    NvtxModule<NVTX_CBID_CUDART_SIZE> cudart;
    NvtxModule<NVTX_CBID_OPENCL_SIZE> opencl;
    NvtxModule<NVTX_CBID_SYNC_SIZE> sync;
    std::intptr_t payload[kNumSlots] = {};
    std::intptr_t counters[kNumSlots] = {};

    /// @returns false if the tool refuses. Not by two threads at once.
    bool fill(const NvtxInjection& tool);

    /// @returns null if the tool has put nothing there
    template <typename Function>
    Function core_function(NvtxCallbackIdCore id) const {
        return reinterpret_cast<Function>(core.functions[id]);
    }
    template <typename Function>
    Function core2_function(NvtxCallbackIdCore2 id) const {
        return reinterpret_cast<Function>(core2.functions[id]);
    }
    /// @param slots  0: not filled, 1: NVTX's word for that
    template <typename Function>
    static Function* function(const std::intptr_t (&slots)[kNumSlots], std::size_t id) {
        return slots[id] == 0 || slots[id] == 1 ? nullptr : reinterpret_cast<Function*>(slots[id]);
    }
};

}  // namespace urgengo::observe
