// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/workloads.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "tools/chains/kernel_mix.h"
#include "tools/chains/spec.h"

namespace urgengo::sim {
namespace {

constexpr std::array kCalibratedMs = {18.620, 20.460, 20.780, 21.914, 14.422,
                                      22.883, 14.419, 21.211, 14.762, 28.795};

double gap_us(const GpuShape& shape) {
    return static_cast<double>(shape.gap.count()) / 1000;
}

double alone_us(const chains::Kernel& kernel, const GpuShape& shape, double block_us) {
    return GpuModel::time_alone_ns(shape, static_cast<std::uint32_t>(kernel.grid),
                                   static_cast<std::uint32_t>(kernel.block), block_us);
}

/// Sets what the kernels take on this GPU, so that the chain's take `chain_ms`.
void calibrate(chains::Chain& chain, const GpuShape& shape, double chain_ms) {
    double sum_us = 0, gaps_us = 0;
    for (chains::Task& task : chain.tasks)
        for (chains::Kernel& kernel : task.kernels) {
            // Iterations are for a multiprocessor with as many blocks as build_task() reckons with.
            const double block_us = kernel.iterations / double(chains::kBlocksPerSm);
            kernel.est_us = alone_us(kernel, shape, block_us);
            sum_us += kernel.est_us;
            gaps_us += gap_us(shape);
        }
    const double factor = (chain_ms * 1000 - gaps_us) / sum_us;
    for (chains::Task& task : chain.tasks) {
        task.isolated_ms = 0;
        for (chains::Kernel& kernel : task.kernels) {
            kernel.est_us = kernel.est_us * factor + gap_us(shape);
            task.isolated_ms += kernel.est_us / 1000;
        }
    }
}

}  // namespace

chains::Workload h200_ten_chains() {
    const GpuShape shape;
    chains::Workload workload;
    workload.gpu = "NVIDIA H200 (model)";
    workload.driver = "none";
    workload.num_sms = shape.num_sms;
    const chains::MixSettings mix;
    workload.seed = mix.seed;
    workload.umin = mix.umin;
    workload.umax = mix.umax;
    // Many iterations, so that they are whole numbers to within a thousandth.
    const chains::IterationCost cost{0.001, 0.001};
    for (const chains::ChainSpec& spec : chains::paper_chains()) {
        chains::Chain chain{spec.name, spec.period_ms, spec.deadline_ms, {}};
        chain.place = workload.chains.size();
        for (const chains::TaskSpec& task : spec.tasks)
            chain.tasks.push_back(
                chains::build_task(task, spec.cpu_ms / double(spec.tasks.size()),
                                   chains::task_seed(mix.seed, chain.place, chain.tasks.size()),
                                   mix, cost, shape.num_sms));
        calibrate(chain, shape, kCalibratedMs[chain.place]);
        workload.chains.push_back(std::move(chain));
    }
    return workload;
}

KernelWork work_of(const chains::Kernel& kernel, const GpuShape& shape, double size) {
    const double own_us = std::max(0.1, kernel.est_us - gap_us(shape));
    KernelWork work;
    work.blocks = static_cast<std::uint32_t>(chains::scaled_grid(kernel, size));
    work.block_threads = static_cast<std::uint32_t>(kernel.block);
    work.block_ns = 1000 * own_us / alone_us(kernel, shape, 1);
    return work;
}

}  // namespace urgengo::sim
