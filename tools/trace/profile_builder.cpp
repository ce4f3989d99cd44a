// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/profile_builder.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "tools/trace/cupti_intervals.h"
#include "tools/trace/gpu_intervals.h"
#include "tools/trace/kernel_set.h"
#include "tools/trace/kernel_times.h"
#include "tools/trace/task_learner.h"

namespace urgengo::trace {
namespace {

/// A measured period that differs by more than this from the chain's is a warning.
constexpr double kPeriodTolerance = 0.2;
/// So is a larger share of launches in no instance, or without a time.
constexpr double kOddShare = 0.1;

double to_ms(std::chrono::nanoseconds time) {
    return std::chrono::duration<double, std::milli>(time).count();
}

double share(std::size_t part, std::size_t whole) {
    return whole == 0 ? 0 : static_cast<double>(part) / static_cast<double>(whole);
}

std::string how_it_is_known(const config::Task& task) {
    std::string rules;
    const auto add = [&rules](const std::string& rule) {
        rules += (rules.empty() ? "" : ", ") + rule;
    };
    if (!task.thread_glob.empty()) add("thread: " + task.thread_glob);
    if (!task.nvtx_glob.empty()) add("nvtx: " + task.nvtx_glob);
    for (const config::KernelPattern& kernel : task.kernels) add("kernels: " + kernel.name_glob);
    return rules.empty() ? "by hints only" : rules;
}

class Builder {
  public:
    Builder(const Trace& trace, const config::Config& config, const Trace* plain)
        : trace_(trace),
          config_(config),
          plain_(plain),
          intervals_(intervals_of(trace)),
          contention_(intervals_),
          segments_(find_segments(trace, TaskMatcher(config, trace))) {
        if (plain_) plain_segments_ = find_segments(*plain_, TaskMatcher(config, *plain_));
    }

    LearnedProfile build(const std::string& program) {
        config::Profile& profile = learned_.profile;
        profile.gpu = trace_.gpu();
        profile.driver = trace_.driver();
        profile.sm_clock_mhz = trace_.header().sm_clock_mhz;
        profile.memory_clock_mhz = trace_.header().memory_clock_mhz;
        profile.program = program;
        learned_.warnings = trace_.warnings();
        if (plain_) {
            learned_.warnings.insert(learned_.warnings.end(), plain_->warnings().begin(),
                                     plain_->warnings().end());
        }
        warn_of_records();
        int index = 0;
        for (const config::Chain& chain : config_.chains) {
            config::ChainProfile chain_profile{chain.name, {}};
            for (const config::Task& task : chain.tasks) {
                chain_profile.tasks.push_back(add_task(chain, task, index++));
            }
            profile.chains.push_back(std::move(chain_profile));
        }
        profile.kernel_set_hash = kernel_set_hash(kernel_names(profile));
        return std::move(learned_);
    }

  private:
    /// Behind those of every thread what is of no launch that was seen: for contention only.
    static std::vector<std::vector<GpuInterval>> intervals_of(const Trace& trace) {
        if (!is_by_cupti(trace)) return gpu_intervals(trace);
        CuptiIntervals found = cupti_intervals(trace);
        found.launches.push_back(std::move(found.others));
        return std::move(found.launches);
    }

    static bool is_by_cupti(const Trace& trace) {
        return trace.header().kernel_times == abi::TraceTimes::kCupti;
    }

    void warn_of_records() {
        const abi::TraceHeader& header = trace_.header();
        const bool has_times =
            std::any_of(intervals_.begin(), intervals_.end(), [](const auto& thread) {
                return std::any_of(thread.begin(), thread.end(),
                                   [](const GpuInterval& interval) { return interval.known; });
            });
        const MarkTimes of_marks = plausible_mark_times(header);
        if (!is_by_cupti(trace_) && has_times && of_marks.mark_ns == 0) {
            learned_.warnings.push_back(fmt::format(
                "what a mark takes was measured as {:.1f} us, accepted: more than 0, 10 at most; "
                "it is not taken off, so kernels are a few us too long",
                static_cast<double>(header.mark_ns) / 1000));
        } else if (!is_by_cupti(trace_) && has_times && of_marks.pause_ns == 0) {
            learned_.warnings.emplace_back(
                "the GPU's pause between a kernel and a mark could not be measured; it is not "
                "taken off, so kernels are 1 to 2 us too long");
        }

        if (const std::uint32_t dropped = trace_.header().dropped_kernels) {
            learned_.warnings.push_back(fmt::format(
                "CUPTI dropped {} kernels' records; instances that lack one do not count",
                dropped));
        }
    }

    config::TaskProfile add_task(const config::Chain& chain, const config::Task& task, int index) {
        const TaskInstances found = find_instances(segments_of(segments_, index), chain.period);
        LearnedTask learned = learn_task({trace_, intervals_, contention_}, found);
        learned.profile.name = task.name;

        TaskReport report;
        report.chain = chain.name;
        report.task = task.name;
        report.boundaries = found.boundaries;
        report.num_launches = found.num_launches;
        report.irregular_launches = found.irregular_launches;
        report.unmarked_launches = learned.unmarked_launches;
        report.samples = learned.samples;
        report.clean_samples = learned.clean_samples;
        report.period = std::chrono::nanoseconds{found.period_ns};
        report.discarded_instances = learned.discarded_instances;
        report.times = {learned.sum, learned.on_side_streams, learned.streams, is_by_cupti(trace_)};
        if (plain_ && !learned.profile.kernels.empty()) {
            const TaskInstances again =
                find_instances(segments_of(plain_segments_, index), chain.period);
            report.pace = learn_pace(*plain_, plain_segments_, again, learned.profile);
        }
        const Check check = check_times(learned.profile, report.times);
        report.verdict = check.verdict;
        warn(report, chain, task, learned.profile, check.why);
        learned_.tasks.push_back(report);
        return learned.profile;
    }

    void warn(const TaskReport& report, const config::Chain& chain, const config::Task& task,
              const config::TaskProfile& profile, const std::string& wrong) {
        const auto add = [&](const std::string& what) {
            learned_.warnings.push_back(
                fmt::format("task '{}' of chain '{}': {}", task.name, chain.name, what));
        };
        if (report.num_launches == 0) {
            const std::string seen = describe_threads(trace_);
            return add(fmt::format("nothing launched matched it ({}); threads that launched: {}",
                                   how_it_is_known(task), seen.empty() ? "none" : seen));
        }
        if (!wrong.empty()) add(wrong);
        if (report.discarded_instances > 0) {
            add(fmt::format(
                "{} of {} instances have launches without a record of CUPTI's, or without times "
                "in it, and do not count",
                report.discarded_instances, report.discarded_instances + profile.instances));
        }
        if (plain_ && report.pace.instances == 0 && !profile.kernels.empty()) {
            add("no instance of the run without timing is like its typical one, so its launch "
                "times and latency are not known");
        }
        if (profile.instances < kFewInstances) {
            add(
                fmt::format("only {} instances were seen, accepted: {} or more (a longer run, or "
                            "--merge with another)",
                            profile.instances, kFewInstances));
        }
        if (report.boundaries == Boundaries::kNone) {
            add("its segments repeat in no pattern and no idle gaps stand out, so every segment "
                "was taken for an instance; hints (urgengo.h), nvtx: or kernels: would tell");
        }
        const double ratio = static_cast<double>(report.period.count()) /
                             static_cast<double>(std::max<std::int64_t>(1, chain.period.count()));
        if (report.period.count() > 0 && std::abs(ratio - 1) > kPeriodTolerance) {
            add(
                fmt::format("measured period {:.2f} ms, accepted: within 20 % of its period_ms, "
                            "{:.2f}",
                            to_ms(report.period), to_ms(chain.period)));
        }
        if (share(report.irregular_launches, report.num_launches) > kOddShare) {
            add(fmt::format("{} of {} launches fit no instance and were left out",
                            report.irregular_launches, report.num_launches));
        }
        const std::size_t in_instances = report.samples + report.unmarked_launches;
        if (share(report.unmarked_launches, in_instances) > kOddShare) {
            add(fmt::format("{} of {} launches have no GPU time (no mark told their end)",
                            report.unmarked_launches, in_instances));
        }
        if (report.samples > 0 && report.clean_samples == 0) {
            add("all launches ran beside others' work, so its times may be too long; --isolated "
                "gives its own");
        }
    }

    const Trace& trace_;
    const config::Config& config_;
    const Trace* const plain_;
    const std::vector<std::vector<GpuInterval>> intervals_;
    const Contention contention_;
    const std::vector<std::vector<Segment>> segments_;
    std::vector<std::vector<Segment>> plain_segments_;
    LearnedProfile learned_;
};

}  // namespace

LearnedProfile learn_profile(const Trace& trace, const config::Config& config,
                             const std::string& program, const Trace* plain) {
    return Builder(trace, config, plain).build(program);
}

std::string describe_threads(const Trace& trace, std::size_t max_names) {
    std::map<std::string, std::size_t> launches;
    for (const ThreadTrace& thread : trace.threads()) {
        for (const TraceRecord* event : thread.events) {
            if (event->kind != TraceKind::kLaunch) continue;
            const std::string_view name = thread.name_at(event->time_ns);
            ++launches[name.empty() ? fmt::format("thread {}", thread.id) : std::string(name)];
        }
    }
    std::vector<std::pair<std::string, std::size_t>> busiest(launches.begin(), launches.end());
    std::stable_sort(busiest.begin(), busiest.end(),
                     [](const auto& a, const auto& b) { return a.second > b.second; });
    std::string text;
    for (std::size_t i = 0; i < std::min(max_names, busiest.size()); ++i) {
        text += fmt::format("{}{} ({})", i == 0 ? "" : ", ", busiest[i].first, busiest[i].second);
    }
    if (busiest.size() > max_names) text += fmt::format(", {} more", busiest.size() - max_names);
    return text;
}

}  // namespace urgengo::trace
