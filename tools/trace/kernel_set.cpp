// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/kernel_set.h"

#include "host/base/hash.h"

namespace urgengo::trace {

std::set<std::string> kernel_names(const config::Profile& profile) {
    std::set<std::string> names;
    for (const config::ChainProfile& chain : profile.chains) {
        for (const config::TaskProfile& task : chain.tasks) {
            for (const auto& kernel : task.kernels) names.insert(kernel.name);
            for (const auto& kernel : task.sizes) names.insert(kernel.name);
        }
    }
    return names;
}

std::uint64_t kernel_set_hash(const std::set<std::string>& names) {
    if (names.empty()) return 0;
    std::string all;
    for (const std::string& name : names) all += name + '\n';
    return fnv1a64(all);
}

}  // namespace urgengo::trace
