// SPDX-License-Identifier: Apache-2.0
//
// UrgenGo as an NVTX tool: NVTX, which is a part of the program (a header), loads the library that
// NVTX_INJECTION64_PATH names and calls its InitializeInjectionNvtx2. We subscribe to the ranges
// that threads push and pop, and to what names them. A program gets the return values that it gets
// without a tool, but for the handles of domains and strings, which it cannot look into.
#pragma once

#include <cstdint>
#include <string_view>

namespace urgengo::interposer {

/// NVTX's way to its tables: NvtxGetExportTableFunc_t.
using NvtxTables = const void* (*)(std::uint32_t table);

/// Is told in the thread whose ranges have changed. Set once, before there is a range; none by
/// default.
struct RangeListener {
    void (*pushed)(std::string_view name) = nullptr;
    void (*popped)() = nullptr;
};
void listen_to_ranges(const RangeListener& listener);

/// @returns whether this copy of NVTX delivers its ranges to observe::this_thread_ranges(). A
///          process may have several: each library that was built with the header calls us.
bool attach_to_nvtx(NvtxTables tables);

}  // namespace urgengo::interposer
