// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/profile_table.h"

#include <fmt/format.h>

#include "tools/urgengo/text_table.h"

namespace urgengo::cli {
namespace {

using config::KernelProfile;
using config::TaskProfile;

constexpr std::size_t kMaxNameLength = 32;

std::string shortened(const std::string& name) {
    return name.size() <= kMaxNameLength ? name : name.substr(0, kMaxNameLength - 2) + "..";
}

double to_ms(std::chrono::nanoseconds time) {
    return std::chrono::duration<double, std::milli>(time).count();
}

std::string first_kernel(const TaskProfile& task) {
    const KernelProfile& first = task.kernels.front();
    return fmt::format("{}@{}x{}", shortened(first.name), first.grid_blocks, first.block_threads);
}

std::vector<std::string> row(const trace::TaskReport& report, const TaskProfile& task) {
    const std::string name =
        report.chain == report.task ? report.task : report.chain + "/" + report.task;
    if (task.kernels.empty()) return {name, "0", "-", "-", "-", "-", "-", "-", "-", "-", "-"};
    double gpu_ms = 0, busy_ms = 0;
    for (const KernelProfile& kernel : task.kernels) {
        gpu_ms += to_ms(kernel.gpu_time);
        busy_ms += to_ms(kernel.gpu_time) * kernel.utilization;
    }
    const double alone_pct = report.samples == 0
                                 ? 0
                                 : 100.0 * static_cast<double>(report.clean_samples) /
                                       static_cast<double>(report.samples);
    return {name,
            std::to_string(task.instances),
            std::to_string(task.kernels.size()),
            std::to_string(task.segments.size()),
            fmt::format("{:.3f}", gpu_ms),
            fmt::format("{:.3f}", to_ms(task.cpu_time)),
            fmt::format("{:.2f}", gpu_ms > 0 ? busy_ms / gpu_ms : 0),
            first_kernel(task),
            task.segments.empty() ? "-" : task.segments.back().closed_by,
            std::to_string(task.start_up_launches),
            fmt::format("{:.0f}", alone_pct)};
}

}  // namespace

std::string profile_table(const trace::LearnedProfile& learned) {
    TextTable table;
    table.add_row({"task", "instances", "N", "M", "GPU ms", "CPU ms", "util", "first kernel",
                   "closed by", "start-up", "alone %"});
    std::size_t index = 0;
    for (const config::ChainProfile& chain : learned.profile.chains) {
        for (const TaskProfile& task : chain.tasks) {
            table.add_row(row(learned.tasks[index++], task));
        }
    }
    return table.text() +
           "N launches in M segments an instance; GPU time of the task alone; start-up: launches "
           "left out;\nalone: share of launches during which no other thread used the GPU\n";
}

}  // namespace urgengo::cli
