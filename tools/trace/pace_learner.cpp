// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/pace_learner.h"

#include <algorithm>

#include "tools/trace/median.h"

namespace urgengo::trace {
namespace {

using std::chrono::nanoseconds;
using Launches = std::vector<const TraceRecord*>;

constexpr std::size_t kMinAlone = 3;

std::int64_t lower_quartile(std::vector<std::int64_t> values) {
    const auto at = values.begin() + static_cast<std::ptrdiff_t>((values.size() - 1) / 4);
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

class PaceLearner {
  public:
    PaceLearner(const Trace& trace, const std::vector<std::vector<Segment>>& segments,
                config::TaskProfile& profile)
        : trace_(trace), segments_(segments), profile_(profile) {
        for (const ThreadTrace& thread : trace.threads()) {
            Launches& launches = launches_.emplace_back();
            for (const TraceRecord* event : thread.events) {
                if (event->kind == TraceKind::kLaunch) launches.push_back(event);
            }
        }
    }

    Pace learn(const TaskInstances& task) {
        std::vector<const Instance*> all, alone;
        for (const Instance& instance : task.instances) {
            if (!has_shape(instance)) continue;
            all.push_back(&instance);
            if (is_alone(instance)) alone.push_back(&instance);
        }
        const Pace pace{all.size(), alone.size()};
        if (all.empty()) return pace;
        const auto& used = alone.size() >= kMinAlone ? alone : all;
        learn_launches(used);
        learn_segments(used);
        return pace;
    }

  private:
    const TraceRecord& launch(const Segment& segment, std::size_t i) const {
        return *launches_[segment.thread][segment.first_launch + i];
    }

    bool has_shape(const Instance& instance) const {
        if (instance.segments.size() != profile_.segments.size()) return false;
        if (instance.num_launches != profile_.kernels.size()) return false;
        std::size_t position = 0;
        for (std::size_t s = 0; s < instance.segments.size(); ++s) {
            const Segment& segment = instance.segments[s];
            if (segment.num_launches != profile_.segments[s].num_launches) return false;
            for (std::size_t i = 0; i < segment.num_launches; ++i) {
                if (launch_name(trace_, launch(segment, i)) != profile_.kernels[position++].name) {
                    return false;
                }
            }
        }
        return true;
    }

    /// No segment of another thread reaches into one of the instance's.
    bool is_alone(const Instance& instance) const {
        for (std::size_t thread = 0; thread < segments_.size(); ++thread) {
            const bool is_own =
                std::any_of(instance.segments.begin(), instance.segments.end(),
                            [thread](const Segment& segment) { return segment.thread == thread; });
            if (is_own) continue;
            for (const Segment& segment : instance.segments) {
                const auto& others = segments_[thread];
                // A thread's segments do not overlap: their ends are in order as well.
                const auto other = std::upper_bound(
                    others.begin(), others.end(), segment.begin_ns,
                    [](std::int64_t time, const Segment& each) { return time < each.end_ns; });
                if (other != others.end() && other->begin_ns < segment.end_ns) return false;
            }
        }
        return true;
    }

    void learn_launches(const std::vector<const Instance*>& instances) {
        std::vector<std::vector<std::int64_t>> times(profile_.kernels.size());
        for (const Instance* instance : instances) {
            std::size_t position = 0;
            for (const Segment& segment : instance->segments) {
                for (std::size_t i = 0; i < segment.num_launches; ++i) {
                    times[position++].push_back(launch(segment, i).time_ns - segment.begin_ns);
                }
            }
        }
        for (std::size_t k = 0; k < times.size(); ++k) {
            profile_.kernels[k].launch_time = nanoseconds{lower_quartile(std::move(times[k]))};
        }
    }

    void learn_segments(const std::vector<const Instance*>& instances) {
        profile_.cpu_time = nanoseconds{0};
        for (std::size_t s = 0; s < profile_.segments.size(); ++s) {
            std::vector<std::int64_t> latency_ns, cpu_ns;
            for (const Instance* instance : instances) {
                const Segment& segment = instance->segments[s];
                cpu_ns.push_back(segment.cpu_ns);
                if (segment.closed_by) latency_ns.push_back(segment.end_ns - segment.begin_ns);
            }
            config::SegmentProfile& segment = profile_.segments[s];
            segment.cpu_time = nanoseconds{median(cpu_ns)};
            segment.latency =
                nanoseconds{latency_ns.empty() ? 0 : lower_quartile(std::move(latency_ns))};
            profile_.cpu_time += segment.cpu_time;
        }
    }

    const Trace& trace_;
    const std::vector<std::vector<Segment>>& segments_;
    config::TaskProfile& profile_;
    std::vector<Launches> launches_;
};

}  // namespace

Pace learn_pace(const Trace& trace, const std::vector<std::vector<Segment>>& segments,
                const TaskInstances& task, config::TaskProfile& profile) {
    return PaceLearner(trace, segments, profile).learn(task);
}

}  // namespace urgengo::trace
