// SPDX-License-Identifier: Apache-2.0
//
// doctor: the driver and the GPU.
#pragma once

#include <optional>
#include <string>

#include "host/base/result.h"
#include "tools/urgengo/doctor/doctor_report.h"
#include "tools/urgengo/doctor/gpu_facts.h"
#include "tools/urgengo/doctor/priority_probe.h"
#include "tools/urgengo/environment.h"

namespace urgengo::cli {

/// The driver's file, and what our library exports beyond it.
/// @param driver  the file; empty: there is none
Findings check_driver_file(const std::string& driver, const std::string& interposer);

/// Whether NVTX finds its tool through our library: the newest one asks the driver for it.
Findings check_nvtx_tools(const std::string& driver, const std::string& interposer,
                          const Environment& environment);

/// @param facts  as find_gpu_facts() answered
Findings check_gpu(const Result<GpuFacts>& facts);

/// @param measured  as probe_priority() answered; nothing if it was not asked
Findings check_priority(const GpuFacts& facts,
                        const std::optional<Result<PriorityMeasurement>>& measured);

/// MPS: whether several processes share the GPU, and their priorities.
/// @param processes  folder of the running processes: /proc
Findings check_mps(const Environment& environment, const std::string& processes = "/proc");

/// @param capabilities  /proc/driver/nvidia/capabilities
Findings check_mig(const GpuFacts& facts, const std::string& capabilities);

}  // namespace urgengo::cli
