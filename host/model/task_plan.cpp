// SPDX-License-Identifier: Apache-2.0
#include "host/model/task_plan.h"

namespace urgengo::model {

TaskPlan::TaskPlan(const config::TaskProfile& profile) : cpu_time_(profile.cpu_time) {
    struct Sum {
        nanoseconds gpu_time{0};
        double utilization = 0;
        int count = 0;
    };
    std::unordered_map<KernelKey, Sum, KeyHash> sums;
    for (const config::KernelProfile& k : profile.kernels) {
        keys_.push_back({fnv1a64(k.name), k.grid_blocks, k.block_threads});
        estimates_.push_back({k.gpu_time, k.utilization});
        Sum& sum = sums[keys_.back()];
        sum.gpu_time += k.gpu_time;
        sum.utilization += k.utilization;
        ++sum.count;
    }
    for (const auto& [key, sum] : sums)
        by_key_[key] = {sum.gpu_time / sum.count, sum.utilization / sum.count};

    remaining_.resize(estimates_.size());
    nanoseconds remaining{0};
    for (std::size_t i = estimates_.size(); i-- > 0;)
        remaining_[i] = remaining += estimates_[i].gpu_time;
}

const KernelEstimate* TaskPlan::find(std::size_t position, const KernelKey& key) const {
    if (position < keys_.size() && keys_[position] == key) return &estimates_[position];
    const auto it = by_key_.find(key);
    return it == by_key_.end() ? nullptr : &it->second;
}

}  // namespace urgengo::model
