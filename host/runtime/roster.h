// SPDX-License-Identifier: Apache-2.0
//
// The config's chains and their tasks, with all that the runtime keeps of them. None comes or goes
// later.
//
// @threads any; what stands in a record says who may write it
#pragma once

#include <memory>
#include <string_view>
#include <vector>

#include "host/config/resolved_config.h"
#include "host/runtime/task.h"
#include "host/sched/tasks.h"

namespace urgengo::runtime {

class Roster {
  public:
    /// Adds all of them to `governed`, and describes them in the page.
    /// @param learns  kernels' times are learned from marks
    /// @param page    outlives it
    Roster(const config::ResolvedConfig& resolved, bool learns, abi::SharedPage& page,
           sched::Tasks& governed);

    const std::vector<std::unique_ptr<ChainState>>& chains() const { return chains_; }
    const std::vector<std::unique_ptr<TaskState>>& tasks() const { return tasks_; }
    TaskState& task(int index) const { return *tasks_[static_cast<std::size_t>(index)]; }

    /// @returns null if there is none of this name
    ChainState* find_chain(std::string_view name) const;
    TaskState* find_task(const ChainState& chain, std::string_view name) const;

    /// @returns whether the profile knows graphs of any task
    bool has_graphs() const { return has_graphs_; }

  private:
    void add_task(ChainState& chain, const config::Task& described,
                  const config::TaskProfile* profile, bool learns, abi::TaskSlot& slot);

    std::vector<std::unique_ptr<ChainState>> chains_;
    std::vector<std::unique_ptr<TaskState>> tasks_;
    bool has_graphs_ = false;
};

}  // namespace urgengo::runtime
