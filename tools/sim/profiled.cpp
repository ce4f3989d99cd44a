// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/profiled.h"

#include <algorithm>
#include <cmath>

#include "tools/sim/branch_times.h"

namespace urgengo::sim {
namespace {

/// Where there is none: nothing is ever late.
constexpr nanoseconds kLongDeadline = std::chrono::hours(1);

nanoseconds from_us(double us) {
    return nanoseconds(std::llround(us * 1000));
}

/// What each kernel adds, and when and where it is launched.
/// @returns the task's latency
nanoseconds tell_branches(config::TaskProfile& profile, const TaskTraits& traits,
                          nanoseconds launch) {
    std::vector<nanoseconds> times;
    for (const config::KernelProfile& kernel : profile.kernels) times.push_back(kernel.gpu_time);
    const BranchTimes known = branch_times(times, traits, launch, {});
    nanoseconds launched{0};
    for (std::size_t i = 0; i < times.size(); ++i) {
        config::KernelProfile& its = profile.kernels[i];
        const LaunchTraits at = i < traits.launches.size() ? traits.launches[i] : LaunchTraits{};
        if (i > 0) launched += std::max(at.step, launch);
        its.gpu_time = known.adds[i];
        its.launch_time = launched;
        its.stream = static_cast<std::uint32_t>(at.branch);
    }
    return known.latency;
}

config::TaskProfile profiled(const chains::Task& task, const TaskTraits& traits,
                             nanoseconds launch) {
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
    nanoseconds latency = from_us(task.isolated_ms * 1000);
    if (!traits.launches.empty()) latency = tell_branches(profile, traits, launch);
    profile.segments = {{profile.cpu_time, place, place, place, "stream", latency}};
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
        const ChainTraits known = i < traits.size() ? traits[i] : ChainTraits{};
        config::ChainProfile its{chain.name, {}};
        for (std::size_t t = 0; t < chain.tasks.size(); ++t)
            its.tasks.push_back(profiled(chain.tasks[t],
                                         t < known.tasks.size() ? known.tasks[t] : TaskTraits{},
                                         known.launch));
        profile.chains.push_back(std::move(its));
    }
    return profile;
}

}  // namespace urgengo::sim
