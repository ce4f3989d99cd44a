// SPDX-License-Identifier: Apache-2.0
//
// What is told of a program's run: at its end, perhaps out of a signal's handler, or whenever a
// caller asks.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "host/base/clock.h"
#include "host/identity/instances.h"
#include "host/identity/task_names.h"
#include "host/observe/statistics.h"
#include "host/runtime/frame_causes.h"
#include "host/runtime/live_guard.h"
#include "host/runtime/task.h"
#include "host/sched/core_load.h"
#include "host/sched/governor.h"

namespace urgengo::runtime {

class Report {
  public:
    /// All outlive it.
    struct Around {
        Clock& clock;
        sched::Governor& governor;
        LiveGuard& guard;
        identity::Instances& instances;
        identity::TaskNames& names;
        const std::vector<std::unique_ptr<identity::ChainState>>& chains;
        const std::vector<std::unique_ptr<TaskState>>& tasks;
        const FrameCauses* causes = nullptr;     ///< null: causes are not told
        const sched::CoreLoad* cores = nullptr;  ///< null: nothing is told of the host's cores
        bool has_nice = false;                   ///< the config has `cpu: {nice}`
    };
    explicit Report(const Around& around) : around_(around) {}

    /// The program has jumped out of a hold. @threads any
    void jumped() { num_jumps_.fetch_add(1, std::memory_order_relaxed); }

    /// @returns what happened, by chain. Frames that never came to their end count as missed once
    ///          their deadline has passed
    std::vector<const observe::ChainStatistics*> statistics();
    /// @returns how long work of no chain kept the GPU busy
    observe::BystanderStatistics bystanders() const;
    /// @returns what a user should know, one line each: tasks that nothing matched and the names
    ///          that were seen, kernels that the profile does not know
    std::vector<std::string> warnings();

  private:
    using Lines = std::vector<std::string>;
    void lost_streams(Lines& lines) const;
    void unmatched_tasks(Lines& lines) const;
    void stopped_holding(Lines& lines) const;
    static void of_chain(const observe::ChainStatistics& chain, Lines& lines);
    void wrong_times(Lines& lines) const;
    void busy_cores(Lines& lines) const;

    const Around around_;
    std::atomic<std::uint32_t> num_jumps_{0};
};

}  // namespace urgengo::runtime
