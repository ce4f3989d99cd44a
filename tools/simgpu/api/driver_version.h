// SPDX-License-Identifier: Apache-2.0
//
// Which driver this library answers like.
#pragma once

#include <string>
#include <vector>

namespace urgengo::simgpu {

/// Of the library: lib/simgpu 13000, lib/simgpu-12.4 12040, lib/simgpu-12.0 12000.
extern const int kDefaultDriver;

/// Reads SIMGPU_DRIVER. It changes what cuDriverGetVersion and cuGetProcAddress answer; what dlsym
/// finds is the library's own.
/// @returns the version as cuDriverGetVersion gives it
int read_driver_version(std::vector<std::string>& problems);

}  // namespace urgengo::simgpu
