// SPDX-License-Identifier: Apache-2.0
//
// Where the parts of UrgenGo lie, relative to the running executable: the same in a build folder
// and in an installation.
#pragma once

#include <string>

#include "host/base/result.h"

namespace urgengo::cli {

/// The config that is read if none is named, in the working directory.
inline constexpr char kDefaultConfig[] = "chains.yaml";

/// lib/urgengo/libcuda.so.1, what programs load instead of the driver's.
Result<std::string> interposer_library();
/// lib/urgengo-own-time/libcuda.so.1, the same measuring its own time (interposer/own_time.h).
Result<std::string> own_time_interposer_library();
/// lib/simgpu/libcuda.so.1, a driver with no GPU behind it.
Result<std::string> simulated_gpu_library();
/// lib/nulldriver/libcuda.so.1, a driver that answers at once.
Result<std::string> null_driver_library();
/// lib/nulldriver/libnull_nvtx_tool.so, an NVTX tool that does nothing.
Result<std::string> null_nvtx_tool();
/// bin/urgengo-bench, what `urgengo bench` hands over to.
Result<std::string> bench_program();
/// bin/urgengo-export, what `urgengo export` hands over to.
Result<std::string> export_program();
/// bin/urgengo_call_bench, which times driver calls.
Result<std::string> call_bench_program();
/// bin/urgengo_launch_bench, which times launches on a GPU.
Result<std::string> launch_bench_program();
/// bin/urgengo-chains, the workload.
Result<std::string> chains_program();
/// share/urgengo/<file>, a config that comes with the workload.
Result<std::string> chains_config(const std::string& file);
/// bin/urgengo, beside the running program: itself, or what urgengo-bench starts programs with.
std::string urgengo_program();

}  // namespace urgengo::cli
