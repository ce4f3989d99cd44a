// SPDX-License-Identifier: Apache-2.0
//
// A kernel launch up to the point where it is queued, for launches and for graph nodes.
#pragma once

#include "tools/simgpu/api/driver_state.h"

namespace urgengo::simgpu {

/// Makes the driver's checks, takes the parameters, computes the cost.
/// @param[in]  context   where it runs; a function of another one is refused
/// @param[in]  priority  the stream's; a launch attribute overrides it
CUresult prepare_kernel(const CUlaunchConfig& config, CUfunction function, void** params,
                        void** extra, bool cooperative, const Context* context, int priority,
                        KernelWork& work);

}  // namespace urgengo::simgpu
