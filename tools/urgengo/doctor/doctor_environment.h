// SPDX-License-Identifier: Apache-2.0
//
// doctor: who else gets into the program, and variables that change how it uses the GPU.
#pragma once

#include <string>

#include "host/base/serialising_tool.h"
#include "host/config/config.h"
#include "tools/urgengo/doctor/doctor_report.h"
#include "tools/urgengo/environment.h"

namespace urgengo::cli {

/// @param interposer    our library, which is no stranger
/// @param preload_file  /etc/ld.so.preload
Findings check_preloaded(const Environment& environment, const std::string& interposer,
                         const std::string& preload_file);

/// CUDA_DEVICE_MAX_CONNECTIONS, CUDA_LAUNCH_BLOCKING, and ours.
/// @param config  what `run` would use
/// @param signs   of tools around `urgengo` itself; those in `environment` are added
Findings check_variables(const Environment& environment, const config::Config& config,
                         ToolSigns signs = {});

}  // namespace urgengo::cli
