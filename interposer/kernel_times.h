// SPDX-License-Identifier: Apache-2.0
//
// By what a traced run's kernels are timed, as URGENGO_TRACE_KERNELS asks for it: by CUPTI, which
// must start before the program's first context, or by marks.
#pragma once

#include "host/base/settings.h"
#include "host/runtime/runtime.h"

namespace urgengo::interposer {

/// Starts CUPTI if the environment asks for it. After the driver's start; the first call counts.
void start_kernel_times();

/// @returns what the runtime is to do; the trace's header says it too, and why not by CUPTI
runtime::TraceOptions kernel_times(const Settings& settings, observe::TraceWriter* writer);

}  // namespace urgengo::interposer
