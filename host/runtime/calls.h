// SPDX-License-Identifier: Apache-2.0
//
// The program's calls as the interposer tells of them, and what it is answered.
#pragma once

#include <cuda.h>

#include <cstdint>

#include "host/exec/stream_priorities.h"
#include "host/identity/launch.h"
#include "host/runtime/task.h"
#include "urgengo/abi/trace_record.h"

namespace urgengo::runtime {

using identity::Launch;

/// What LaunchPath::before() grants.
struct Grant {
    TaskState* task = nullptr;  ///< null: of no chain, forward untouched
    bool traced = false;        ///< after() is to be called even so
    bool may_load = false;      ///< of no chain, of a kernel that may be loaded: no gate is closed
    bool scheduled = false;     ///< else the launch is only counted
    bool set_priority = false;
    int priority = 0;
    bool may_be_timed = false;  ///< behind a timing event: no mark right behind the launch
    const exec::MarkContext* context = nullptr;  ///< the current one, if scheduled
    nanoseconds estimate{0};
    std::uint64_t kernel = 0;  ///< model::kernel_id(), if scheduled
    nanoseconds time{0};       ///< when it was granted
};

/// A call of the program that waits for the GPU.
struct Wait {
    abi::TraceWait function = abi::TraceWait::kStream;
    CUstream stream = nullptr;  ///< of kStream, kCopy, kStreamQuery
    exec::StreamFlavor flavor = exec::StreamFlavor::kLegacy;
    CUevent event = nullptr;  ///< of kEvent, kEventQuery
    nanoseconds begin{0};     ///< set by Waits::before()
    bool for_all = false;     ///< set by Waits::before(): it waits for all that the thread launched
};

}  // namespace urgengo::runtime
