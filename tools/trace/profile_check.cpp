// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/profile_check.h"

#include <fmt/format.h>

#include <algorithm>

namespace urgengo::trace {
namespace {

using std::chrono::nanoseconds;

/// Busy for longer than the latency by this much does not add up.
constexpr double kTolerance = 1.1;
/// Marks tell a task apart that has less than this of its work on other streams than the first.
constexpr double kForkedShare = 0.05;

double to_ms(nanoseconds time) {
    return std::chrono::duration<double, std::milli>(time).count();
}

Check refuse(config::TaskProfile& task, std::string why) {
    task.kernels.clear();
    task.sizes.clear();
    task.segments.clear();
    return {Verdict::kRefused, std::move(why)};
}

void scale(std::vector<config::KernelProfile>& kernels, double factor) {
    for (config::KernelProfile& kernel : kernels) {
        kernel.gpu_time = nanoseconds{
            static_cast<std::int64_t>(static_cast<double>(kernel.gpu_time.count()) * factor)};
        kernel.samples = 0;
    }
}

}  // namespace

nanoseconds busy_time(const config::TaskProfile& task) {
    nanoseconds sum{0};
    for (const config::KernelProfile& kernel : task.kernels) sum += kernel.gpu_time;
    return sum;
}

nanoseconds latency(const config::TaskProfile& task) {
    nanoseconds sum{0};
    for (const config::SegmentProfile& segment : task.segments) {
        if (segment.latency == nanoseconds{0}) return nanoseconds{0};
        sum += segment.latency;
    }
    return sum;
}

Check check_times(config::TaskProfile& task, const TaskTimes& times) {
    if (task.kernels.empty()) return {};
    const nanoseconds busy = busy_time(task), alone = latency(task);
    if (busy == nanoseconds{0}) {
        return refuse(task, "all of its kernels would take no time, so nothing was written of it");
    }
    const bool is_forked =
        times.streams > 1 && static_cast<double>(times.on_side_streams.count()) >
                                 kForkedShare * static_cast<double>(times.sum.count());
    if (is_forked && !times.by_cupti) {
        return refuse(task, fmt::format("it launches on {} streams at a time, which marks cannot "
                                        "time, so nothing was written of it; --source cupti can",
                                        times.streams));
    }
    if (alone == nanoseconds{0} ||
        static_cast<double>(busy.count()) <= kTolerance * static_cast<double>(alone.count())) {
        return {};
    }
    const double factor = static_cast<double>(alone.count()) / static_cast<double>(busy.count());
    scale(task.kernels, factor);
    scale(task.sizes, factor);
    return {Verdict::kGuess,
            fmt::format("its kernels would keep the GPU busy for {:.3f} ms, but alone it takes "
                        "{:.3f} ms from first launch to end: its times were scaled to that, and "
                        "are a guess",
                        to_ms(busy), to_ms(alone))};
}

}  // namespace urgengo::trace
