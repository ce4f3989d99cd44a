// SPDX-License-Identifier: Apache-2.0
//
// The NVTX tool behind ours (URGENGO_NVTX_TOOL): the library that the program's NVTX would have
// loaded. It is loaded when NVTX first asks for us, and given the program's own tables to fill, so
// that what we do not listen to reaches it without us.
#pragma once

#include "host/observe/nvtx_link.h"
#include "interposer/nvtx_tool.h"

namespace urgengo::interposer {

using NvtxToolBehind = observe::NvtxInjection;

/// @returns the tool; one that exports nothing if none is asked for, or it cannot be loaded, which
///          is said once. Any thread; takes no lock of ours, as loading takes the loader's.
const NvtxToolBehind& nvtx_tool_behind();

/// @returns the tool that our own events go to: the one behind ours, else the one that
///          NVTX_INJECTION64_PATH names, if that is not us
const NvtxToolBehind& nvtx_tool_of_process();

}  // namespace urgengo::interposer
