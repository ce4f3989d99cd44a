// SPDX-License-Identifier: Apache-2.0
#include "host/observe/kernel_list.h"

#include <algorithm>
#include <limits>
#include <string_view>
#include <unordered_map>
#include <utility>

#include "host/observe/shared_file.h"

namespace urgengo::observe {
namespace {

const config::TaskProfile* find(const config::Profile& profile, std::string_view chain,
                                std::string_view task) {
    for (const config::ChainProfile& c : profile.chains)
        if (c.name == chain)
            for (const config::TaskProfile& t : c.tasks)
                if (t.name == task) return &t;
    return nullptr;
}

class Lister {
  public:
    std::uint32_t add(const config::TaskProfile& task) {
        const std::size_t first = list.launches.size();
        if (task.kernels.empty() || first + task.kernels.size() > abi::kMostPlannedLaunches)
            return 0;
        for (const config::KernelProfile& kernel : task.kernels) {
            const std::int64_t ns = std::clamp<std::int64_t>(
                kernel.gpu_time.count(), 0, std::numeric_limits<std::uint32_t>::max());
            list.launches.push_back({static_cast<std::uint32_t>(ns), name_of(kernel.name), 0});
        }
        return static_cast<std::uint32_t>(first) + 1;
    }

    KernelList list;

  private:
    std::uint16_t name_of(const std::string& name) {
        const auto [found, is_new] =
            index_.try_emplace(name, static_cast<std::uint16_t>(list.names.size()));
        if (!is_new) return found->second;
        if (list.names.size() == abi::kMostKernelNames) return found->second = abi::kNoKernelName;
        copy_name(list.names.emplace_back().name, name);
        return found->second;
    }

    std::unordered_map<std::string_view, std::uint16_t> index_;  ///< into the profile's names
};

}  // namespace

KernelList list_kernels(const config::Config& config, const config::Profile* profile) {
    Lister lister;
    for (const config::Chain& chain : config.chains)
        for (const config::Task& task : chain.tasks) {
            const auto* const known = profile ? find(*profile, chain.name, task.name) : nullptr;
            lister.list.first_launch.push_back(known ? lister.add(*known) : 0);
        }
    return std::move(lister.list);
}

}  // namespace urgengo::observe
