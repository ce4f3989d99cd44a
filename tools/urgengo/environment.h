// SPDX-License-Identifier: Apache-2.0
//
// The environment that a scheduled program gets, as a function of the one that we have. Pure but
// for current_environment().
#pragma once

#include <map>
#include <string>
#include <vector>

namespace urgengo::cli {

using Environment = std::map<std::string, std::string>;

Environment current_environment();

/// @returns "NAME=value" lines, for exec
std::vector<std::string> to_lines(const Environment& environment);

/// What `urgengo run` adds. An empty text leaves its variable as it is.
struct ScheduledProgram {
    std::string interposer;    ///< absolute path of our libcuda.so.1
    std::string config;        ///< URGENGO_CONFIG
    std::string mode;          ///< URGENGO_MODE
    std::string stats;         ///< URGENGO_STATS
    std::string trace;         ///< URGENGO_RUN_TRACE
    std::string real_libcuda;  ///< URGENGO_REAL_LIBCUDA
    bool summary = true;       ///< URGENGO_SUMMARY
    bool nvtx = false;    ///< NVTX_INJECTION64_PATH; a tool that it named is URGENGO_NVTX_TOOL then
    int connections = 0;  ///< CUDA_DEVICE_MAX_CONNECTIONS, if not set already; 0: keep
};

/// Our library comes first in LD_PRELOAD, its folder first in LD_LIBRARY_PATH; what was there
/// stays.
Environment scheduled_environment(Environment environment, const ScheduledProgram& program);

/// @returns `environment` without every trace of UrgenGo: its variables, and LD_PRELOAD entries and
///          an NVTX tool that are `interposer`; the tool that was behind it is the tool again
Environment bare_environment(Environment environment, const std::string& interposer);

/// Puts `folder` first in LD_LIBRARY_PATH, once.
void prepend_library_folder(Environment& environment, const std::string& folder);

}  // namespace urgengo::cli
