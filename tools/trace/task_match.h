// SPDX-License-Identifier: Apache-2.0
//
// Which of a config's tasks a launch is of, as far as the trace alone can tell: by NVTX range, by
// the kernel that begins a task, by the thread's name. Tasks are numbered over all chains, in
// order, as TraceRecord::task does. Where a task has several rules, all of them must hold.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "host/config/config.h"
#include "tools/trace/trace_reader.h"

namespace urgengo::trace {

inline constexpr int kNoTask = -1;

class TaskMatcher {
  public:
    /// @param config, trace  outlive the matcher
    TaskMatcher(const config::Config& config, const Trace& trace);

    int num_tasks() const { return static_cast<int>(tasks_.size()); }

    /// @returns the task of this NVTX range on a thread of this name, or kNoTask
    int by_range(std::uint64_t range_hash, std::string_view thread_name) const;
    /// @returns the task that this kernel begins on a thread of this name, or kNoTask
    int by_kernel(const TraceRecord& launch, std::string_view thread_name) const;
    /// @returns the task known by the thread's name alone, or kNoTask
    int by_thread(std::string_view thread_name) const;

  private:
    bool begins(const config::KernelPattern& pattern, const TraceRecord& launch) const;

    const Trace& trace_;
    std::vector<const config::Task*> tasks_;
    bool has_kernels_ = false;
};

}  // namespace urgengo::trace
