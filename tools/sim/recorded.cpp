// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/recorded.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <set>
#include <utility>

#include "tools/sim/profiled.h"

namespace urgengo::sim {
namespace {

/// As the programs of tools/bench/programs have it (frames.py).
constexpr std::size_t kMostWaiting = 2;
constexpr double kJitterOfPeriod = 0.1;
/// What a frame's CPU segments differ by from their mean, as urgengo-chains'.
constexpr double kCpuSpread = 0.1;

double to_us(nanoseconds time) {
    return double(time.count()) / 1e3;
}

nanoseconds from_ms(double ms) {
    return nanoseconds(static_cast<std::int64_t>(ms * 1e6));
}

template <typename T>
const T* find(const std::vector<T>& list, const std::string& name) {
    const auto found =
        std::find_if(list.begin(), list.end(), [&](const T& one) { return one.name == name; });
    return found == list.end() ? nullptr : &*found;
}

/// @returns what the simulation lacks for it; empty: nothing
std::string lacks(const config::TaskProfile& task) {
    if (task.kernels.empty()) return "a task with no launches";
    if (task.segments.size() > 1)
        return "a task that waits " + std::to_string(task.segments.size()) + " times";
    if (find(task.kernels, config::kGraphName)) return "a task that launches graphs";
    return {};
}

// 1 How many blocks of each kernel a multiprocessor holds, at most.
class Residency {
  public:
    explicit Residency(const GpuShape& shape) : shape_(shape) {}

    void see(const config::KernelProfile& kernel) {
        const double blocks = double(kernel.grid_blocks);
        const double by_warps = blocks * kernel.block_threads /
                                (kBusyShareOfWarps * shape_.threads_per_sm * shape_.num_sms);
        int& most = most_.try_emplace(key(kernel), by_threads(kernel)).first->second;
        if (kernel.utilization <= by_warps * kSame || kernel.utilization <= 0) return;
        const double held = blocks / (kernel.utilization * shape_.num_sms);
        most = std::clamp(static_cast<int>(held * kSame), 1, most);
    }
    int of(const config::KernelProfile& kernel) const { return most_.at(key(kernel)); }

  private:
    static constexpr double kSame = 1.001;  ///< to within what a file's digits say
    using Key = std::pair<std::string, std::uint32_t>;
    static Key key(const config::KernelProfile& kernel) {
        return {kernel.name, kernel.block_threads};
    }
    int by_threads(const config::KernelProfile& kernel) const {
        return std::max(1, shape_.threads_per_sm / static_cast<int>(kernel.block_threads));
    }
    const GpuShape& shape_;
    std::map<Key, int> most_;
};

chains::Task workload_of(const config::TaskProfile& profile, const Residency& residency,
                         const GpuShape& shape) {
    chains::Task task;
    task.name = profile.name;
    const bool has_segment = !profile.segments.empty();
    task.cpu_ms = to_us(has_segment ? profile.segments[0].cpu_time : profile.cpu_time) / 1000;
    for (const config::KernelProfile& its : profile.kernels) {
        chains::Kernel kernel;
        kernel.grid = static_cast<int>(
            std::min<std::uint64_t>(its.grid_blocks, std::numeric_limits<int>::max()));
        kernel.block = shape.threads_per_sm / residency.of(its);
        kernel.est_us = to_us(its.gpu_time + shape.gap);
        kernel.utilization = its.utilization;
        task.isolated_ms += kernel.est_us / 1000;
        task.kernels.push_back(kernel);
    }
    return task;
}

// 2 Fork and join.
TaskTraits traits_of(const config::TaskProfile& profile) {
    TaskTraits traits;
    std::set<int> open;  // branches that have gone off
    int last = 0;
    nanoseconds before{0};
    for (const config::KernelProfile& kernel : profile.kernels) {
        LaunchTraits its;
        its.branch = static_cast<int>(kernel.stream);
        its.step = kernel.launch_time - before;
        before = std::max(before, kernel.launch_time);
        if (its.branch == 0 && last != 0) {
            its.after.assign(open.begin(), open.end());
            open.clear();
        } else if (its.branch != 0 && open.insert(its.branch).second) {
            its.after = {0};
        }
        last = its.branch;
        traits.launches.push_back(std::move(its));
    }
    traits.joins.assign(open.begin(), open.end());
    return traits;
}

}  // namespace

Result<RecordedProgram> recorded(const config::Config& config, const config::Profile& profile) {
    const GpuShape shape;
    RecordedProgram program{config, profile, {}, {}};
    program.profile.chains.clear();
    program.workload.gpu = profile.gpu + " (model)";
    program.workload.driver = profile.driver;
    program.workload.num_sms = shape.num_sms;
    Residency residency(shape);
    for (const config::ChainProfile& chain : profile.chains)
        for (const config::TaskProfile& task : chain.tasks)
            for (const config::KernelProfile& kernel : task.kernels) residency.see(kernel);
    for (const config::Chain& chain : config.chains) {
        const config::ChainProfile* const its = find(profile.chains, chain.name);
        if (!its) return Error{"profile: found no chain '" + chain.name + "'"};
        config::ChainProfile ordered{chain.name, {}};
        chains::Chain workload{
            chain.name, to_us(chain.period) / 1000, to_us(chain.deadline) / 1000, {}};
        workload.place = program.workload.chains.size();
        ChainTraits traits;
        traits.most_waiting = kMostWaiting;
        for (const config::Task& task : chain.tasks) {
            const std::string name = chain.name + "/" + task.name;
            const config::TaskProfile* const known = find(its->tasks, task.name);
            if (!known) return Error{"profile: found no task '" + name + "'"};
            if (const std::string what = lacks(*known); !what.empty())
                return Error{"profile: " + name + ": found " + what +
                             ", simulated: tasks that launch kernels and wait once"};
            workload.tasks.push_back(workload_of(*known, residency, shape));
            traits.tasks.push_back(traits_of(*known));
            ordered.tasks.push_back(*known);
        }
        program.profile.chains.push_back(std::move(ordered));
        program.workload.chains.push_back(std::move(workload));
        program.traits.push_back(std::move(traits));
    }
    return program;
}

std::string set_times(RecordedProgram& program, const std::vector<ChainTimes>& times) {
    for (std::size_t i = 0; i < program.config.chains.size(); ++i) {
        config::Chain& chain = program.config.chains[i];
        const ChainTimes* const its = find(times, chain.name);
        if (!its) return chain.name;
        chain.period = from_ms(its->period_ms);
        chain.deadline = from_ms(its->deadline_ms);
        program.workload.chains[i].period_ms = its->period_ms;
        program.workload.chains[i].deadline_ms = its->deadline_ms;
        for (TaskTraits& task : program.traits[i].tasks)
            for (LaunchTraits& launch : task.launches)
                launch.step = nanoseconds(std::llround(double(launch.step.count()) * its->pace));
    }
    return {};
}

std::vector<std::vector<chains::PlannedFrame>> recorded_frames(const chains::Workload& workload,
                                                               const chains::Scenario& scenario,
                                                               double seconds, std::uint32_t seed) {
    std::vector<std::vector<chains::PlannedFrame>> all;
    std::uniform_real_distribution<double> any_phase(0, 1), any_jitter(0, kJitterOfPeriod),
        any_cpu(1 - kCpuSpread, 1 + kCpuSpread);
    for (const chains::Chain& chain : workload.chains) {
        std::seed_seq seeds{seed, static_cast<std::uint32_t>(chain.place)};
        std::mt19937 random(seeds);
        const double period_ms = scenario.period_ms(chain), phase = any_phase(random);
        auto& frames = all.emplace_back();
        for (int i = 0; (phase + i) * period_ms < seconds * 1000; ++i) {
            chains::PlannedFrame frame;
            frame.arrival = from_ms((phase + i + any_jitter(random)) * period_ms);
            for (const chains::Task& task : chain.tasks)
                frame.cpu.push_back(from_ms(task.cpu_ms * any_cpu(random)));
            frame.size.assign(chain.tasks.size(), 1);
            frames.push_back(std::move(frame));
        }
    }
    return all;
}

}  // namespace urgengo::sim
