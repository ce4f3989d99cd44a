// SPDX-License-Identifier: Apache-2.0
//
// A config held against a trace: which rule gave each task its launches, which launches several
// tasks' rules claim, and what no rule claims.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "host/config/config.h"
#include "tools/discover/observation.h"
#include "tools/trace/instances.h"

namespace urgengo::discover {

/// What made a launch a task's. In the order in which they decide.
enum class MatchedBy { kHint, kNvtx, kKernels, kThread, kStream };
inline constexpr std::size_t kNumMatchedBy = 5;

/// @returns "hint", "nvtx", "kernels", "thread", "stream"
const char* matched_by_name(MatchedBy by);

struct TaskClaims {
    std::string chain, name;  ///< as in the config
    std::size_t launches = 0;
    std::int64_t gpu_ns = 0;
    std::array<std::size_t, kNumMatchedBy> by{};  ///< launches
    trace::TaskInstances instances;
    std::chrono::nanoseconds period{0};  ///< as configured
};

/// GPU time of a thread's name that no task has.
struct Unexplained {
    std::size_t launches = 0;
    std::int64_t gpu_ns = 0;
    std::map<std::string, std::int64_t> kernels;  ///< GPU time by short name
};

struct Claims {
    std::vector<TaskClaims> tasks;  ///< over all chains, in order
    /// Launches that the first task has and the second task's rules claim, too.
    std::map<std::pair<int, int>, std::size_t> doubles;
    std::map<std::string, Unexplained> unexplained;  ///< by thread name
    std::int64_t total_gpu_ns = 0;
    /// What was seen, with its launches: for tasks that nothing matched.
    std::map<std::string, std::size_t> thread_names, range_names, first_kernels;
};

/// @param seen  made with the config's tasks
Claims find_claims(const config::Config& config, const Observation& seen);

/// @returns the report for people
std::string format_claims(const config::Config& config, const Claims& claims);

/// @returns whether every task of the config has launches
bool all_matched(const Claims& claims);

}  // namespace urgengo::discover
