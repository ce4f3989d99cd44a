// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/bench_config.h"

#include "host/base/atomic_file.h"
#include "host/config/resolved_config.h"

namespace urgengo::bench {
namespace {

using namespace std::chrono_literals;

// Small, so that all of them fit beside each other and none is ever held.
constexpr double kUtilization = 0.01;
// Far more than a benchmark takes, and far less than the deadline: never overdue, never late.
constexpr std::chrono::nanoseconds kOthersKernel = 10min;
constexpr std::chrono::nanoseconds kOthersDeadline = 24h;
constexpr std::chrono::nanoseconds kMeasuredDeadline = 10s;

config::Chain chain(const std::string& name, const std::string& thread,
                    std::chrono::nanoseconds deadline) {
    config::Chain result;
    result.name = name;
    result.period = result.deadline = deadline;
    config::Task task;
    task.name = name;
    task.thread_glob = thread;
    result.tasks.push_back(task);
    return result;
}

config::ChainProfile profile(const std::string& name, int num_launches,
                             std::chrono::nanoseconds gpu_time) {
    config::KernelProfile kernel;
    kernel.name = kKernel;
    kernel.grid_blocks = 1;
    kernel.block_threads = kKernelThreads;
    kernel.gpu_time = gpu_time;
    kernel.utilization = kUtilization;
    config::TaskProfile task;
    task.name = name;
    task.kernels.assign(static_cast<std::size_t>(num_launches), kernel);
    const auto launches = static_cast<std::uint32_t>(num_launches);
    task.segments = {{0ns, launches, launches, launches, "stream"}};
    return {name, {task}};
}

}  // namespace

std::string write_config(const std::string& path, const ConfigSpec& spec) {
    config::Config config;
    config::Profile known;
    config.scheduler = spec.scheduler;
    for (const MeasuredChain& measured : spec.measured) {
        config.chains.push_back(chain(measured.name, measured.thread, kMeasuredDeadline));
        known.chains.push_back(
            profile(measured.name, measured.frame_launches,
                    std::chrono::nanoseconds(static_cast<std::int64_t>(measured.kernel_us * 1e3))));
    }
    for (int i = 1; i <= spec.num_others; ++i) {
        const std::string name = other_chain(i);
        config.chains.push_back(chain(name, name, kOthersDeadline));
        known.chains.push_back(profile(name, 1, kOthersKernel));
    }
    const auto written = write_file_atomically(path, config::to_resolved_json(config, &known, {}));
    return written ? "" : written.error();
}

}  // namespace urgengo::bench
