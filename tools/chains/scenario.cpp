// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/scenario.h"

#include <algorithm>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace urgengo::chains {

bool Scenario::is_tight(const Chain& chain) const {
    return std::find(tight.begin(), tight.end(), chain.name) != tight.end();
}

void check_scenario(const Scenario& scenario, const Workload& workload) {
    std::vector<std::string> names;
    for (const Chain& chain : workload.chains) names.push_back(chain.name);
    for (const std::string& name : scenario.tight) {
        if (std::find(names.begin(), names.end(), name) == names.end()) {
            throw std::runtime_error(
                fmt::format("--tight: found \"{}\", accepted: {}", name, fmt::join(names, ", ")));
        }
    }
}

std::string thread_name(Threads threads, const Chain& chain, const Task& task) {
    return threads == Threads::kPerChain ? chain.name : chain.name + "." + task.name;
}

}  // namespace urgengo::chains
