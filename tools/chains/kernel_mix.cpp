// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/kernel_mix.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

namespace urgengo::chains {

namespace {

constexpr double kShortestKernelUs = 4;
constexpr double kWaveUs = 60;

// As many iterations as workload.json accepts.
int to_iterations(double count) {
    return static_cast<int>(std::clamp(count, 1.0, double(1 << 24)));
}

}  // namespace

std::uint32_t task_seed(std::uint32_t seed, std::size_t chain, std::size_t task) {
    const std::uint32_t base = 100 + (seed - MixSettings{}.seed) * 1000;
    return base + static_cast<std::uint32_t>(chain * 10 + task);
}

Task build_task(const TaskSpec& spec, double cpu_ms, std::uint32_t seed,
                const MixSettings& settings, const IterationCost& cost, int num_sms) {
    std::mt19937 random(seed);
    std::lognormal_distribution<double> any_weight(0, 0.8);
    std::uniform_real_distribution<double> any_utilization(settings.umin, settings.umax);
    // Apart from `random`, so that the share does not change the sizes.
    std::mt19937 kind_random(seed);
    std::bernoulli_distribution is_memory(settings.memory_share);

    std::vector<double> weights(static_cast<std::size_t>(spec.num_kernels));
    for (double& weight : weights) weight = any_weight(random);
    const double weight_sum = std::accumulate(weights.begin(), weights.end(), 0.0);
    const double gpu_us = spec.gpu_ms * settings.gpu_scale * 1000;

    Task task;
    task.name = spec.name;
    task.cpu_ms = cpu_ms;
    task.min_inputs = spec.min_inputs;
    task.max_inputs = spec.max_inputs;
    for (const double weight : weights) {
        Kernel kernel;
        kernel.kind = is_memory(kind_random) ? KernelKind::kMemory : KernelKind::kCompute;
        kernel.block = kBlockThreads;
        kernel.est_us = std::max(kShortestKernelUs, gpu_us * weight / weight_sum);
        kernel.utilization = any_utilization(random);
        const int waves = std::max(1, static_cast<int>(std::round(kernel.est_us / kWaveUs)));
        const int blocks_per_wave =
            std::max(1, static_cast<int>(kernel.utilization * num_sms * kBlocksPerSm));
        kernel.grid = blocks_per_wave * waves;
        const double iteration_us =
            kernel.kind == KernelKind::kCompute ? cost.compute_us : cost.memory_us;
        kernel.iterations = to_iterations(kernel.est_us / waves / iteration_us);
        task.kernels.push_back(kernel);
    }
    return task;
}

void scale_iterations(Task& task, double factor) {
    for (Kernel& kernel : task.kernels) {
        kernel.iterations = to_iterations(std::round(kernel.iterations * factor));
    }
}

void set_isolated_ms(Task& task, double measured_ms) {
    double estimate_us = 0;
    for (const Kernel& kernel : task.kernels) estimate_us += kernel.est_us;
    for (Kernel& kernel : task.kernels) kernel.est_us *= measured_ms * 1000 / estimate_us;
    task.isolated_ms = measured_ms;
}

}  // namespace urgengo::chains
