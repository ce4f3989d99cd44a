// SPDX-License-Identifier: Apache-2.0
//
// The functions of simgpu.h.
#include "tools/simgpu/api/driver_state.h"
#include "tools/simgpu/api/launch_call.h"

using namespace urgengo::simgpu;

SIMGPU_API size_t simgpu_kernel_log(simgpu_kernel_record* out, size_t max) {
    return driver().kernel_log.read(out, max);
}

SIMGPU_API void simgpu_kernel_log_clear() {
    driver().kernel_log.clear();
}

SIMGPU_API void simgpu_set_launch_hook(simgpu_launch_hook hook) {
    LaunchCall::set_hook(hook);
}
