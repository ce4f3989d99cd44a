// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/exec/driver_api.h"

namespace urgengo::identity {

/// @returns the driver's own text: see name_gate.h for how long it stays; null: it has none
const char* kernel_name(const exec::DriverApi& driver, CUfunction function);

}  // namespace urgengo::identity
