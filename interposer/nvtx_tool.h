// SPDX-License-Identifier: Apache-2.0
//
// UrgenGo as an NVTX tool: NVTX, which is a part of the program (a header), loads the library that
// NVTX_INJECTION64_PATH names and calls its InitializeInjectionNvtx2. We subscribe to the ranges
// that threads push and pop, and to what names them. A program gets the return values that it gets
// without a tool, but for the handles of domains and strings, which it cannot look into.
//
// Behind us there may be another tool (nvtx_behind.h). It fills the program's tables as if we were
// not there; then we put ourselves before the few functions that we listen to. Arguments, results
// and handles are the other tool's, unchanged.
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

/// @param behind  InitializeInjectionNvtx2 of the tool behind us; null: there is none. If it
///                refuses, the tables are as they were before it, which is said once.
/// @returns whether this copy of NVTX has a tool: us, or the other one. With us it delivers its
///          ranges to observe::this_thread_ranges(). A process may have several copies: each
///          library that was built with the header calls us.
bool attach_to_nvtx(NvtxTables tables, int (*behind)(NvtxTables) = nullptr);
/// @returns whether the tool behind us has refused a copy of NVTX that we have attached to
bool nvtx_tool_has_refused();

}  // namespace urgengo::interposer
