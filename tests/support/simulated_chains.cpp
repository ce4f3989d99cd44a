// SPDX-License-Identifier: Apache-2.0
#include "tests/support/simulated_chains.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "tools/sim/governed_subject.h"
#include "tools/sim/profiled.h"
#include "tools/sim/world.h"

namespace urgengo::testing {
namespace {

constexpr int kBlockThreads = 256;
constexpr int kBlocksPerSm = 4;  ///< of a kernel that fills the GPU

double to_ms(nanoseconds time) {
    return double(time.count()) / 1e6;
}

chains::Task task_of(const SimulatedTask& its, std::size_t index, const sim::GpuShape& shape) {
    chains::Task task;
    task.name = fmt::format("t{}", index);
    task.cpu_ms = to_ms(its.cpu);
    task.isolated_ms = to_ms(its.gpu);
    for (nanoseconds left = its.gpu; left.count() > 0; left -= its.kernel) {
        chains::Kernel kernel;
        kernel.block = kBlockThreads;
        kernel.grid = std::max(
            1, static_cast<int>(std::lround(its.utilization * shape.num_sms * kBlocksPerSm)));
        kernel.est_us = 1000 * to_ms(std::min(left, its.kernel));
        kernel.utilization = its.utilization;
        task.kernels.push_back(kernel);
    }
    return task;
}

chains::Workload workload_of(const std::vector<SimulatedChain>& list) {
    const sim::GpuShape shape;
    chains::Workload workload;
    workload.num_sms = shape.num_sms;
    for (const SimulatedChain& its : list) {
        chains::Chain chain;
        chain.place = workload.chains.size();
        chain.name = fmt::format("c{}", chain.place);
        chain.period_ms = to_ms(its.period);
        chain.deadline_ms = to_ms(its.deadline);
        for (const SimulatedTask& task : its.tasks)
            chain.tasks.push_back(task_of(task, chain.tasks.size(), shape));
        workload.chains.push_back(std::move(chain));
    }
    return workload;
}

std::vector<chains::PlannedFrame> frames_of(const SimulatedChain& chain, nanoseconds duration) {
    std::vector<chains::PlannedFrame> frames;
    for (nanoseconds at = chain.phase; at < duration; at += chain.period) {
        chains::PlannedFrame frame;
        frame.arrival = at;
        for (const SimulatedTask& task : chain.tasks) frame.cpu.push_back(task.cpu);
        frame.size.assign(chain.tasks.size(), 1);
        frames.push_back(std::move(frame));
    }
    return frames;
}

/// What has not ended when the run does counts where it should have.
SimulatedOutcome outcome_of(const chains::ChainReport& report, const SimulatedChain& chain,
                            nanoseconds duration) {
    SimulatedOutcome outcome;
    for (const chains::InstanceRecord& record : report.records) {
        const bool is_over = record.outcome != chains::Outcome::kNotRun;
        if (!is_over && record.arrival + chain.deadline >= duration) continue;
        ++outcome.instances;
        outcome.missed += record.outcome != chains::Outcome::kOnTime;
    }
    return outcome;
}

}  // namespace

std::vector<SimulatedOutcome> simulate(const std::vector<SimulatedChain>& chains,
                                       const SimulatedSettings& settings) {
    const chains::Workload workload = workload_of(chains);
    sim::WorldSettings world;
    world.cpu.wake_up_tail = nanoseconds{0};  // no chain's sleeps change another's
    world.seconds = to_ms(settings.duration) / 1000;
    world.progress = [](double part) { return part < 1; };
    config::Config config = sim::configured(workload, world.scenario, settings.scheduler);
    for (std::size_t i = 0; i < chains.size(); ++i) {
        config.chains[i].criticality = chains[i].criticality;
        config.chains[i].on_late = chains[i].on_late;
        world.traits.emplace_back();
        world.traits.back().never_ends = chains[i].is_dead;
        world.frames.push_back(frames_of(chains[i], settings.duration));
    }
    sim::GovernedSubject subject(config, sim::profiled(workload));
    const chains::RunReport report = sim::World(workload, subject, world).run();
    std::vector<SimulatedOutcome> outcomes;
    for (std::size_t i = 0; i < chains.size(); ++i) {
        outcomes.push_back(outcome_of(report.chains[i], chains[i], settings.duration));
        outcomes.back().longest_hold = subject.longest_hold(static_cast<int>(i));
    }
    return outcomes;
}

double mean_miss_ratio(const std::vector<SimulatedOutcome>& outcomes) {
    double sum = 0;
    for (const SimulatedOutcome& o : outcomes) sum += o.miss_ratio();
    return outcomes.empty() ? 0 : sum / static_cast<double>(outcomes.size());
}

}  // namespace urgengo::testing
