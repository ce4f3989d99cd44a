// SPDX-License-Identifier: Apache-2.0
//
// The one thing, besides its exports, in which the libraries of the different drivers differ.
#include "tools/simgpu/api/driver_version.h"

namespace urgengo::simgpu {

const int kDefaultDriver = SIMGPU_DEFAULT_DRIVER;

}  // namespace urgengo::simgpu
