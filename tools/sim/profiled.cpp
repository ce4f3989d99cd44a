// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/profiled.h"

#include <algorithm>
#include <cmath>

namespace urgengo::sim {
namespace {

/// Where there is none: nothing is ever late.
constexpr nanoseconds kLongDeadline = std::chrono::hours(1);

nanoseconds from_us(double us) {
    return nanoseconds(std::llround(us * 1000));
}

config::TaskProfile profiled(const chains::Task& task, nanoseconds launch) {
    const GpuShape shape;
    const int threads = shape.num_sms * shape.threads_per_sm;
    config::TaskProfile profile;
    profile.name = task.name;
    profile.cpu_time = from_us(task.cpu_ms * 1000);
    std::uint32_t place = 0;
    for (const chains::Kernel& kernel : task.kernels) {
        config::KernelProfile its;
        its.name = chains::kernel_name(kernel.kind);
        its.grid_blocks = static_cast<std::uint64_t>(kernel.grid);
        its.block_threads = static_cast<std::uint32_t>(kernel.block);
        its.gpu_time = std::max(from_us(kernel.est_us) - shape.gap, nanoseconds{1});
        its.utilization = std::min(
            1.0, double(kernel.grid) * kernel.block / (kBusyShareOfWarps * double(threads)));
        its.samples = 10;
        its.launch_time = place++ * launch;
        profile.kernels.push_back(std::move(its));
    }
    if (place == 0) return profile;
    profile.segments = {
        {profile.cpu_time, place, place, place, "stream", from_us(task.isolated_ms * 1000)}};
    return profile;
}

}  // namespace

config::Config configured(const chains::Workload& workload, const chains::Scenario& scenario,
                          const config::Scheduler& scheduler) {
    config::Config config;
    config.scheduler = scheduler;
    for (const chains::Chain& chain : workload.chains) {
        config::Chain its;
        its.name = chain.name;
        its.period = from_us(scenario.period_ms(chain) * 1000);
        its.deadline =
            scenario.deadlines ? from_us(scenario.deadline_ms(chain) * 1000) : kLongDeadline;
        its.on_late = config::OnLate::kExit;
        its.arrival = config::ArrivalFrom::kHint;
        for (const chains::Task& task : chain.tasks) its.tasks.push_back({task.name});
        config.chains.push_back(std::move(its));
    }
    return config;
}

config::Profile profiled(const chains::Workload& workload, const std::vector<ChainTraits>& traits) {
    config::Profile profile;
    for (std::size_t i = 0; i < workload.chains.size(); ++i) {
        const chains::Chain& chain = workload.chains[i];
        const nanoseconds launch = i < traits.size() ? traits[i].launch : kLaunch;
        config::ChainProfile its{chain.name, {}};
        for (const chains::Task& task : chain.tasks) its.tasks.push_back(profiled(task, launch));
        profile.chains.push_back(std::move(its));
    }
    return profile;
}

}  // namespace urgengo::sim
