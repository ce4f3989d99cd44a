// SPDX-License-Identifier: Apache-2.0
//
// UrgenGo as an NVTX tool: NVTX, which is a part of the program (a header), loads the library that
// NVTX_INJECTION64_PATH names and calls its InitializeInjectionNvtx2. We subscribe to the ranges
// that threads push and pop, and to what names them. A program gets the return values that it gets
// without a tool, but for the handles of domains and strings, which it cannot look into.
#pragma once

#include <cstdint>

namespace urgengo::interposer {

/// NVTX's way to its tables: NvtxGetExportTableFunc_t.
using NvtxTables = const void* (*)(std::uint32_t table);

/// @returns whether this copy of NVTX delivers its ranges to observe::this_thread_ranges(). A
///          process may have several: each library that was built with the header calls us.
bool attach_to_nvtx(NvtxTables tables);

}  // namespace urgengo::interposer
