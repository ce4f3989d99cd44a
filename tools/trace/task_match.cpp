// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/task_match.h"

#include <fnmatch.h>

#include <algorithm>
#include <string>

namespace urgengo::trace {
namespace {

bool matches(const std::string& glob, std::string_view text) {
    return fnmatch(glob.c_str(), std::string(text).c_str(), 0) == 0;
}

bool may_run_on(const config::Task& task, std::string_view thread_name) {
    return task.thread_glob.empty() || matches(task.thread_glob, thread_name);
}

}  // namespace

TaskMatcher::TaskMatcher(const config::Config& config, const Trace& trace) : trace_(trace) {
    for (const config::Chain& chain : config.chains) {
        for (const config::Task& task : chain.tasks) {
            tasks_.push_back(&task);
            has_kernels_ = has_kernels_ || !task.kernels.empty();
        }
    }
}

int TaskMatcher::by_range(std::uint64_t range_hash, std::string_view thread_name) const {
    const std::string_view range = trace_.text(range_hash);
    for (int i = 0; i < num_tasks(); ++i) {
        const config::Task& task = *tasks_[static_cast<std::size_t>(i)];
        if (task.nvtx_glob.empty() || !matches(task.nvtx_glob, range)) continue;
        if (may_run_on(task, thread_name)) return i;
    }
    return kNoTask;
}

bool TaskMatcher::begins(const config::KernelPattern& pattern, const TraceRecord& launch) const {
    if (pattern.grid_blocks != 0 && pattern.grid_blocks != launch.launch.grid_blocks) return false;
    if (pattern.block_threads != 0 && pattern.block_threads != launch.launch.block_threads) {
        return false;
    }
    return matches(pattern.name_glob, trace_.text(launch.launch.name_hash));
}

int TaskMatcher::by_kernel(const TraceRecord& launch, std::string_view thread_name) const {
    if (!has_kernels_ || (launch.flags & abi::kTraceGraph)) return kNoTask;
    for (int i = 0; i < num_tasks(); ++i) {
        const config::Task& task = *tasks_[static_cast<std::size_t>(i)];
        // A task with a range as well is told by its range, which says more.
        if (!task.nvtx_glob.empty() || !may_run_on(task, thread_name)) continue;
        if (std::any_of(task.kernels.begin(), task.kernels.end(),
                        [&](const auto& pattern) { return begins(pattern, launch); })) {
            return i;
        }
    }
    return kNoTask;
}

int TaskMatcher::by_thread(std::string_view thread_name) const {
    for (int i = 0; i < num_tasks(); ++i) {
        const config::Task& task = *tasks_[static_cast<std::size_t>(i)];
        if (task.thread_glob.empty() || !task.nvtx_glob.empty() || !task.kernels.empty()) continue;
        if (matches(task.thread_glob, thread_name)) return i;
    }
    return kNoTask;
}

}  // namespace urgengo::trace
