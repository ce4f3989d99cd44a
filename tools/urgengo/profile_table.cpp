// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/profile_table.h"

#include <fmt/format.h>

#include "tools/trace/profile_check.h"
#include "tools/urgengo/text_table.h"

namespace urgengo::cli {
namespace {

using config::KernelProfile;
using config::TaskProfile;

constexpr std::size_t kMaxNameLength = 32;
constexpr std::size_t kNumColumns = 17;

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

/// Times of the run without timing had something beside them, so they may be too long.
constexpr std::size_t kFewAlone = 3;

std::string latency_ms(const trace::TaskReport& report, const TaskProfile& task) {
    const auto latency = trace::latency(task);
    if (latency.count() == 0) return "-";
    return fmt::format("{}{:.3f}", report.pace.alone < kFewAlone ? "<" : "", to_ms(latency));
}

std::string pct(double part, double whole) {
    return whole > 0 ? fmt::format("{:.0f}", 100 * part / whole) : "-";
}

std::string how_known(const trace::TaskReport& report) {
    return fmt::format("{}{}", report.times.by_cupti ? "cupti" : "marks",
                       report.verdict == trace::Verdict::kGuess ? ", guess" : "");
}

std::vector<std::string> row(const trace::TaskReport& report, const TaskProfile& task) {
    const std::string name =
        report.chain == report.task ? report.task : report.chain + "/" + report.task;
    if (task.kernels.empty()) {
        std::vector<std::string> none = {name, "0"};
        none.resize(kNumColumns, "-");
        if (report.verdict == trace::Verdict::kRefused) none.back() = "refused";
        return none;
    }
    double used_ms = 0;
    for (const KernelProfile& kernel : task.kernels) {
        used_ms += to_ms(kernel.gpu_time) * kernel.utilization;
    }
    const double busy_ms = to_ms(trace::busy_time(task));
    return {name,
            std::to_string(task.instances),
            std::to_string(task.kernels.size()),
            std::to_string(task.segments.size()),
            fmt::format("{:.3f}", busy_ms),
            fmt::format("{:.3f}", to_ms(report.times.sum)),
            latency_ms(report, task),
            bound_by(task),
            fmt::format("{:.3f}", to_ms(task.cpu_time)),
            std::to_string(report.times.streams),
            pct(to_ms(report.times.on_side_streams), to_ms(report.times.sum)),
            fmt::format("{:.2f}", busy_ms > 0 ? used_ms / busy_ms : 0),
            first_kernel(task),
            task.segments.empty() ? "-" : task.segments.back().closed_by,
            std::to_string(task.start_up_launches),
            pct(static_cast<double>(report.clean_samples), static_cast<double>(report.samples)),
            how_known(report)};
}

}  // namespace

std::string bound_by(const config::TaskProfile& task) {
    if (trace::latency(task).count() == 0) return "-";
    std::chrono::nanoseconds launching{0};
    std::size_t end = 0;
    for (const config::SegmentProfile& segment : task.segments) {
        end += segment.num_launches;
        if (end > 0 && end <= task.kernels.size()) launching += task.kernels[end - 1].launch_time;
    }
    return launching > trace::busy_time(task) ? "launch" : "GPU";
}

std::string profile_table(const trace::LearnedProfile& learned) {
    TextTable table;
    table.add_row({"task", "instances", "N", "M", "busy ms", "sum ms", "latency ms", "bound",
                   "CPU ms", "streams", "side %", "util", "first kernel", "closed by", "start-up",
                   "alone %", "by"});
    std::size_t index = 0;
    for (const config::ChainProfile& chain : learned.profile.chains) {
        for (const TaskProfile& task : chain.tasks) {
            table.add_row(row(learned.tasks[index++], task));
        }
    }
    return table.text() +
           "N launches in M segments an instance; busy: at least one of its kernels executes, "
           "alone "
           "on the GPU;\nsum: of its kernels; latency: first launches to ends of waits, in a run "
           "in which nothing is timed (<: beside\nothers); bound: what takes longer, launching or "
           "the GPU; side: of its kernels' time on other streams\nthan the first; start-up: "
           "launches left out; alone: share of launches during which no other thread used\nthe "
           "GPU; by: what timed the kernels\n";
}

}  // namespace urgengo::cli
