// SPDX-License-Identifier: Apache-2.0
//
// What other topics need of events.
#pragma once

#include "tools/simgpu/api/driver_state.h"

namespace urgengo::simgpu {

/// @returns the fence of the event's last record; one that has passed if it was never recorded
Fence last_record(Event& event);

}  // namespace urgengo::simgpu
