// SPDX-License-Identifier: Apache-2.0
//
// urgengo-chains calibrate: fits the paper's tasks to this GPU.
//
//   1 Warm up until the clocks are at their working frequency, and time one iteration of a kernel
//     that fills the GPU.
//   2 Build each task's kernels from that (kernel_mix.h).
//   3 With --gpu-time paper: run each task alone, and scale its iterations until it takes the
//     paper's time. With --gpu-time nominal (default): leave them. A kernel is then sized as if it
//     filled the GPU, so one of utilisation U takes about U of its nominal time alone, and a task
//     about two thirds of the paper's; this is the mix of the published prototype measurements.
//   4 Measure every task, and every kernel of it, alone: what a scheduler may know.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <memory>
#include <vector>

#include <fmt/format.h>

#include "tools/chains/cmd.h"
#include "tools/chains/files.h"
#include "tools/chains/gpu.h"
#include "tools/chains/kernel_mix.h"
#include "tools/chains/spec.h"
#include "tools/chains/task_stream.h"
#include "tools/log/log.h"

namespace urgengo::chains {

namespace {

constexpr std::chrono::milliseconds kWarmUp{600};
constexpr double kTolerance = 0.02;  // of a task's GPU time
constexpr int kMaxCorrections = 4;
constexpr int kIterationSamples = 9;
constexpr int kTaskSamples = 5;
constexpr int kKernelSamples = 3;

struct CalibrateOptions {
    std::string out = "workload.json";
    std::string gpu_time = "nominal";
    bool variable = false;
    MixSettings mix;
};

/// Times work on one stream with events, alone on the GPU.
class Timer {
  public:
    explicit Timer(const Gpu& gpu) : stream_(gpu) {}

    /// @returns the median of `samples` times, after one that does not count
    double median_ms(int samples, const std::function<void(TaskStream&)>& launch) {
        sample_ms(launch);
        std::vector<double> times;
        for (int i = 0; i < samples; i++) times.push_back(sample_ms(launch));
        std::nth_element(times.begin(), times.begin() + samples / 2, times.end());
        return times[static_cast<std::size_t>(samples / 2)];
    }

  private:
    double sample_ms(const std::function<void(TaskStream&)>& launch) {
        begin_.record(stream_.stream());
        launch(stream_);
        end_.record(stream_.stream());
        end_.synchronize();
        return end_.ms_since(begin_);
    }

    TaskStream stream_;
    Event begin_, end_;
};

Kernel full_kernel(const Gpu& gpu, KernelKind kind, int iterations) {
    Kernel kernel;
    kernel.kind = kind;
    kernel.grid = gpu.num_sms() * kBlocksPerSm;
    kernel.block = kBlockThreads;
    kernel.iterations = iterations;
    return kernel;
}

void warm_up(const Gpu& gpu) {
    TaskStream stream(gpu);
    const Kernel kernel = full_kernel(gpu, KernelKind::kCompute, 20'000);
    const auto end = std::chrono::steady_clock::now() + kWarmUp;
    while (std::chrono::steady_clock::now() < end) {
        for (int i = 0; i < 4; i++) stream.launch(kernel);
        stream.synchronize();
    }
}

double iteration_us(const Gpu& gpu, Timer& timer, KernelKind kind, int iterations) {
    const Kernel kernel = full_kernel(gpu, kind, iterations);
    const double ms =
        timer.median_ms(kIterationSamples, [&](TaskStream& stream) { stream.launch(kernel); });
    return ms * 1000 / iterations;
}

/// Scales the task until it takes `target_ms` alone, within the tolerance.
void fit(Task& task, double target_ms, Timer& timer) {
    for (int correction = 0; correction < kMaxCorrections; correction++) {
        const double measured_ms =
            timer.median_ms(kTaskSamples, [&](TaskStream& stream) { stream.launch(task.kernels); });
        if (std::abs(measured_ms / target_ms - 1) <= kTolerance) return;
        scale_iterations(task, target_ms / measured_ms);
    }
}

/// Measures the task's time, and each kernel's share of it.
void measure(Task& task, Timer& timer) {
    for (Kernel& kernel : task.kernels)
        kernel.est_us =
            1000 * timer.median_ms(kKernelSamples, [&](TaskStream& s) { s.launch(kernel); });
    // Events add a little to each kernel that they time alone: the sum is the task's.
    set_isolated_ms(task,
                    timer.median_ms(kTaskSamples, [&](TaskStream& s) { s.launch(task.kernels); }));
}

/// @returns GPU seconds asked for per second at f_a 1, one kernel at a time
double gpu_demand(const Workload& workload) {
    double demand = 0;
    for (const Chain& chain : workload.chains)
        for (const Task& task : chain.tasks) demand += task.isolated_ms / chain.period_ms;
    return demand;
}

void run_calibrate(const CalibrateOptions& options) {
    if (options.mix.umin > options.mix.umax) {
        throw std::runtime_error(fmt::format("--umin {} --umax {}: accepted: umin <= umax",
                                             options.mix.umin, options.mix.umax));
    }
    Gpu gpu;
    tools::log_info("{}, {} multiprocessors: warming up", gpu.name(), gpu.num_sms());
    gpu.prepare_memory_input();
    warm_up(gpu);
    Timer timer(gpu);
    IterationCost cost;
    cost.compute_us = iteration_us(gpu, timer, KernelKind::kCompute, 20'000);
    cost.memory_us = iteration_us(gpu, timer, KernelKind::kMemory, 500);
    tools::log_info("one iteration: {:.5f} us computing, {:.5f} us reading", cost.compute_us,
                    cost.memory_us);

    Workload workload;
    workload.gpu = gpu.name();
    workload.driver = gpu.kernel_driver_version().empty() ? "CUDA " + gpu.cuda_driver_version()
                                                          : gpu.kernel_driver_version();
    workload.num_sms = gpu.num_sms();
    workload.seed = options.mix.seed;
    workload.umin = options.mix.umin;
    workload.umax = options.mix.umax;
    workload.gpu_scale = options.mix.gpu_scale;
    workload.memory_share = options.mix.memory_share;
    workload.variable = options.variable;
    const auto& specs = paper_chains();
    for (std::size_t i = 0; i < specs.size(); i++) {
        const ChainSpec& spec = specs[i];
        Chain chain{spec.name, spec.period_ms, spec.deadline_ms, {}};
        for (std::size_t j = 0; j < spec.tasks.size(); j++) {
            Task task =
                build_task(spec.tasks[j], spec.cpu_ms / double(spec.tasks.size()),
                           task_seed(options.mix.seed, i, j), options.mix, cost, gpu.num_sms());
            const double paper_ms = spec.tasks[j].gpu_ms * options.mix.gpu_scale;
            if (options.gpu_time == "paper") fit(task, paper_ms, timer);
            measure(task, timer);
            tools::log_info("{} {:<10} {:4} kernels {:8.2f} ms alone, {:6.2f} in the paper",
                            spec.name, task.name, task.kernels.size(), task.isolated_ms, paper_ms);
            chain.tasks.push_back(std::move(task));
        }
        workload.chains.push_back(std::move(chain));
    }
    write_file(options.out, format_workload(workload));
    tools::log_info(
        "wrote {}: GPU time asked for at f_a 1 is {:.2f} of this GPU's, one kernel at a time",
        options.out, gpu_demand(workload));
}

}  // namespace

void add_calibrate(CLI::App& app) {
    auto options = std::make_shared<CalibrateOptions>();
    CLI::App* command = app.add_subcommand(
        "calibrate", "Fit the paper's tasks to this GPU, with nothing else running on it");
    command->add_option("--out", options->out, "Workload to write")->capture_default_str();
    command
        ->add_option("--gpu-time", options->gpu_time,
                     "paper: each task takes the paper's time alone; nominal: each kernel is sized "
                     "as if it filled the GPU")
        ->check(CLI::IsMember({"nominal", "paper"}))
        ->capture_default_str();
    command->add_option("--umin", options->mix.umin, "Least utilisation of a kernel")
        ->check(CLI::Range(0.01, 1.0))
        ->capture_default_str();
    command->add_option("--umax", options->mix.umax, "Greatest utilisation of a kernel")
        ->check(CLI::Range(0.01, 1.0))
        ->capture_default_str();
    command->add_option("--seed", options->mix.seed, "Seed of the kernels' sizes")
        ->capture_default_str();
    command->add_option("--gpu-scale", options->mix.gpu_scale, "Factor on every task's GPU time")
        ->check(CLI::Range(0.01, 100.0))
        ->capture_default_str();
    command
        ->add_option("--memory-share", options->mix.memory_share,
                     "Share of kernels that stream memory instead of computing")
        ->check(CLI::Range(0.0, 1.0))
        ->capture_default_str();
    command->add_flag("--variable", options->variable,
                      "Let the inputs of detect3d, track, path and icp vary in size "
                      "from frame to frame, in the paper's ranges");
    command->callback([options] { run_calibrate(*options); });
}

}  // namespace urgengo::chains
