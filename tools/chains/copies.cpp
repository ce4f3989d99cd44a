// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/copies.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace urgengo::chains {

namespace {

constexpr std::size_t kMaxThreadName = 15;

Task merged(const Chain& chain) {
    Task task = chain.tasks.front();
    for (std::size_t i = 1; i < chain.tasks.size(); i++) {
        const Task& next = chain.tasks[i];
        task.cpu_ms += next.cpu_ms;
        task.isolated_ms += next.isolated_ms;
        task.kernels.insert(task.kernels.end(), next.kernels.begin(), next.kernels.end());
    }
    return task;
}

}  // namespace

void keep_only(Workload& workload, const std::vector<std::string>& names) {
    std::vector<Chain> kept;
    for (const std::string& name : names) {
        const auto found = std::find_if(workload.chains.begin(), workload.chains.end(),
                                        [&](const Chain& chain) { return chain.name == name; });
        if (found == workload.chains.end()) {
            std::vector<std::string> known;
            for (const Chain& chain : workload.chains) known.push_back(chain.name);
            throw std::runtime_error(
                fmt::format("--only: found \"{}\", accepted: {}", name, fmt::join(known, ", ")));
        }
        kept.push_back(*found);
    }
    workload.chains = std::move(kept);
}

void merge_tasks(Workload& workload) {
    for (Chain& chain : workload.chains) {
        const auto varies = [](const Task& task) { return task.min_inputs != task.max_inputs; };
        if (std::any_of(chain.tasks.begin(), chain.tasks.end(), varies)) {
            throw std::runtime_error(fmt::format(
                "--merge-tasks: found {}, whose inputs differ in size, accepted: chains whose "
                "inputs have one size (C2, C3, C5, C7)",
                chain.name));
        }
        chain.tasks = {merged(chain)};
    }
}

void make_copies(Workload& workload, std::size_t copies) {
    std::vector<Chain> all;
    for (const Chain& chain : workload.chains) {
        for (std::size_t i = 0; i < copies; i++) {
            Chain copy = chain;
            copy.name = copy_name(chain.name, i);
            copy.copy_of = chain.name;
            copy.place = all.size();
            for (const Task& task : copy.tasks) {
                const std::string thread = copy.name + "." + task.name;
                if (thread.size() > kMaxThreadName) {
                    throw std::runtime_error(
                        fmt::format("--copies: found the thread name \"{}\", accepted: at most {} "
                                    "bytes",
                                    thread, kMaxThreadName));
                }
            }
            all.push_back(std::move(copy));
        }
    }
    workload.chains = std::move(all);
}

}  // namespace urgengo::chains
