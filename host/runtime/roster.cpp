// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/roster.h"

#include <unistd.h>

#include <algorithm>

#include "host/config/limits.h"
#include "host/sched/instance_slot.h"

namespace urgengo::runtime {
namespace {

static_assert(config::kMaxTasks == abi::kMaxTasks, "a config's tasks fit into the page");

const config::TaskProfile* find_profile(const std::optional<config::Profile>& profile,
                                        const std::string& chain, const std::string& task) {
    if (!profile) return nullptr;
    for (const config::ChainProfile& c : profile->chains)
        if (c.name == chain)
            for (const config::TaskProfile& t : c.tasks)
                if (t.name == task) return &t;
    return nullptr;
}

// By their names, which no kernel can have: "(graph)", "(graph of 53 kernels, 8f3a12bc)".
bool knows_graphs(const config::TaskProfile& profile) {
    return std::any_of(profile.kernels.begin(), profile.kernels.end(),
                       [](const auto& kernel) { return kernel.name.starts_with("(graph"); });
}

}  // namespace

Roster::Roster(const config::ResolvedConfig& resolved, bool learns, abi::SharedPage& page,
               sched::Tasks& governed) {
    for (const config::Chain& c : resolved.config.chains) {
        auto& chain = *chains_.emplace_back(std::make_unique<ChainState>());
        governed.add(chain);
        chain.config = c;
        chain.index = chains_.size() - 1;
        chain.statistics.name = c.name;
        chain.would_wait_for =
            std::vector<std::atomic<std::uint64_t>>(resolved.config.chains.size());
        for (const config::Task& t : c.tasks) {
            add_task(chain, t, find_profile(resolved.profile, c.name, t.name), learns,
                     page.tasks[tasks_.size()]);
            governed.add(*tasks_.back());
        }
        for (const int index : chain.tasks) sched::describe_chain(governed, governed[index]);
    }
    for (const auto& task : tasks_) task->views.reserve(tasks_.size());
    sched::rank_chains(governed);
    page.num_tasks = static_cast<std::uint32_t>(tasks_.size());
}

void Roster::add_task(ChainState& chain, const config::Task& described,
                      const config::TaskProfile* profile, bool learns, abi::TaskSlot& slot) {
    auto& task = *tasks_.emplace_back(std::make_unique<TaskState>());
    task.index = static_cast<int>(tasks_.size()) - 1;
    task.chain = &chain;
    task.stage = chain.tasks.size();
    task.known_by.config = described;
    if (profile) {
        task.plan = model::TaskPlan(*profile);
        has_graphs_ |= knows_graphs(*profile);
    }
    task.tracker = model::InstanceTracker(task.plan);
    task.record.cpu = model::CpuSegments(task.plan.cpu_segments());
    if (learns) task.learning = std::make_unique<progress::Learning>(task.plan);
    task.record.learns = learns;
    task.slot = &slot;
    sched::describe_task(task, static_cast<std::uint32_t>(getpid()));
    chain.tasks.push_back(task.index);
}

ChainState* Roster::find_chain(std::string_view name) const {
    const auto found = std::find_if(chains_.begin(), chains_.end(),
                                    [&](const auto& chain) { return chain->config.name == name; });
    return found == chains_.end() ? nullptr : found->get();
}

TaskState* Roster::find_task(const ChainState& chain, std::string_view name) const {
    const auto found = std::find_if(chain.tasks.begin(), chain.tasks.end(),
                                    [&](int index) { return task(index).name() == name; });
    return found == chain.tasks.end() ? nullptr : &task(*found);
}

}  // namespace urgengo::runtime
