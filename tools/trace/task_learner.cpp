// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/task_learner.h"

#include <algorithm>
#include <map>
#include <tuple>

#include "tools/trace/median.h"

namespace urgengo::trace {
namespace {

using std::chrono::nanoseconds;

/// The most frequent instance is typical if at least this share of all is like it.
constexpr double kMinTypicalShare = 0.2;

/// A kernel, as large as it was launched.
using Size = std::tuple<std::uint64_t, std::uint32_t, std::uint16_t>;

Size size_of(const TraceRecord& record) {
    return {record.launch.name_hash, record.launch.grid_blocks, record.launch.block_threads};
}

/// The launches of one kernel, or at one position.
struct Samples {
    std::vector<KernelSample> known;
    double utilization = 0;  ///< summed
    std::size_t count = 0;
    const TraceRecord* any = nullptr;
    OwnTime time;

    double mean_utilization() const {
        return count == 0 ? 0 : utilization / static_cast<double>(count);
    }
};

/// Names and segments of an instance, not sizes.
using Shape = std::vector<std::uint64_t>;

class TaskLearner {
  public:
    TaskLearner(const TraceView& view, const TaskInstances& task) : view_(view), task_(task) {}

    LearnedTask learn() {
        learned_.profile.instances = static_cast<std::uint32_t>(task_.instances.size());
        learned_.profile.start_up_launches = static_cast<std::uint32_t>(task_.start_up_launches);
        if (task_.instances.empty()) return learned_;
        collect_sizes();
        find_typical();
        learn_positions();
        learn_sizes();
        learn_segments();
        return learned_;
    }

  private:
    template <typename Each>
    void for_each_launch(const Instance& instance, Each&& each) const {
        std::size_t position = 0;
        for (const Segment& segment : instance.segments) {
            for (std::size_t i = 0; i < segment.num_launches; ++i) {
                each(position++, segment.thread,
                     view_.intervals[segment.thread][segment.first_launch + i]);
            }
        }
    }

    void add(Samples& samples, std::size_t thread, const GpuInterval& interval) const {
        samples.any = interval.launch;
        samples.utilization += utilization_of(*interval.launch);
        ++samples.count;
        if (!interval.known) return;
        samples.known.push_back(
            {interval.length_ns(), view_.contention.of(thread, interval), interval.shared > 1});
    }

    void collect_sizes() {
        for (const Instance& instance : task_.instances) {
            for_each_launch(instance, [&](std::size_t, std::size_t thread, const auto& interval) {
                add(sizes_[size_of(*interval.launch)], thread, interval);
            });
        }
        for (auto& [size, samples] : sizes_) {
            samples.time = own_time(samples.known);
            learned_.samples += samples.known.size();
            learned_.clean_samples += samples.time.clean;
            learned_.unmarked_launches += samples.count - samples.known.size();
        }
    }

    Shape shape_of(const Instance& instance) const {
        Shape shape;
        for (const Segment& segment : instance.segments) shape.push_back(segment.num_launches);
        for_each_launch(instance, [&](std::size_t, std::size_t, const auto& interval) {
            shape.push_back(interval.launch->launch.name_hash);
        });
        return shape;
    }

    void find_typical() {
        std::map<Shape, std::vector<const Instance*>> shapes;
        std::vector<std::size_t> counts;
        for (const Instance& instance : task_.instances) {
            shapes[shape_of(instance)].push_back(&instance);
            counts.push_back(instance.num_launches);
        }
        const std::size_t usual = median(counts);
        const auto total = static_cast<double>(task_.instances.size());
        for (const auto& [shape, instances] : shapes) {
            if (instances.size() > typical_.size()) typical_ = instances;
        }
        if (static_cast<double>(typical_.size()) >= kMinTypicalShare * total) return;
        typical_.clear();
        for (const auto& [shape, instances] : shapes) {
            if (instances[0]->num_launches != usual) continue;
            if (instances.size() > typical_.size()) typical_ = instances;
        }
    }

    config::KernelProfile kernel(const Samples& samples) const {
        const abi::TraceLaunch& launch = samples.any->launch;
        config::KernelProfile kernel;
        kernel.name = launch_name(view_.trace, *samples.any);
        // A graph has no size.
        kernel.grid_blocks = std::max<std::uint64_t>(1, launch.grid_blocks);
        kernel.block_threads = std::max<std::uint32_t>(1, launch.block_threads);
        kernel.gpu_time = nanoseconds{samples.time.ns};
        kernel.utilization = samples.mean_utilization();
        kernel.samples = samples.time.samples;
        return kernel;
    }

    void learn_positions() {
        const std::size_t count = typical_[0]->num_launches;
        std::vector<Samples> positions(count);
        std::vector<std::map<Size, std::size_t>> seen(count);
        for (const Instance* instance : typical_) {
            for_each_launch(*instance, [&](std::size_t k, std::size_t thread, const auto& each) {
                add(positions[k], thread, each);
                ++seen[k][size_of(*each.launch)];
            });
        }
        for (std::size_t k = 0; k < count; ++k) {
            if (seen[k].size() == 1) {
                positions[k].time = own_time(positions[k].known);
                same_size_[seen[k].begin()->first].push_back(positions[k].time);
            } else {
                take_mean(positions[k], seen[k]);
            }
            learned_.profile.kernels.push_back(kernel(positions[k]));
        }
    }

    /// The mean over the sizes that the position was seen with, and the most frequent of them.
    void take_mean(Samples& position, const std::map<Size, std::size_t>& seen) const {
        double sum_ns = 0;
        std::size_t count = 0, most = 0;
        for (const auto& [size, times] : seen) {
            const Samples& samples = sizes_.at(size);
            if (times > most) most = times, position.any = samples.any;
            if (samples.known.empty()) continue;
            sum_ns += static_cast<double>(samples.time.ns) * static_cast<double>(times);
            count += times;
        }
        if (count > 0) {
            position.time.ns = static_cast<std::int64_t>(sum_ns / static_cast<double>(count));
        }
        position.time.samples = static_cast<std::uint32_t>(count);
    }

    void learn_sizes() {
        for (auto& [size, samples] : sizes_) {
            if (samples.known.empty()) continue;
            const auto positions = same_size_.find(size);
            if (positions != same_size_.end()) {
                std::int64_t sum_ns = 0, known = 0;
                for (const OwnTime& time : positions->second) {
                    if (time.samples > 0) sum_ns += time.ns, ++known;
                }
                if (known > 0) samples.time.ns = sum_ns / known;
            }
            learned_.profile.sizes.push_back(kernel(samples));
        }
        std::sort(learned_.profile.sizes.begin(), learned_.profile.sizes.end(),
                  [](const auto& a, const auto& b) {
                      return std::tie(a.name, a.grid_blocks, a.block_threads) <
                             std::tie(b.name, b.grid_blocks, b.block_threads);
                  });
    }

    void learn_segments() {
        const std::vector<Segment>& typical = typical_[0]->segments;
        for (std::size_t i = 0; i < typical.size(); ++i) {
            config::SegmentProfile segment;
            std::vector<std::int64_t> cpu_ns;
            std::map<std::string_view, std::size_t> waits;
            for (const Instance* instance : typical_) {
                cpu_ns.push_back(instance->segments[i].cpu_ns);
                ++waits[instance->segments[i].closed_by_name()];
            }
            segment.cpu_time = nanoseconds{median(cpu_ns)};
            segment.closed_by =
                std::max_element(waits.begin(), waits.end(), [](const auto& a, const auto& b) {
                    return a.second < b.second;
                })->first;
            segment.num_launches = static_cast<std::uint32_t>(typical[i].num_launches);
            segment.min_launches = segment.max_launches = segment.num_launches;
            for (const Instance& instance : task_.instances) {
                if (instance.segments.size() != typical.size()) continue;
                const auto launches = static_cast<std::uint32_t>(instance.segments[i].num_launches);
                segment.min_launches = std::min(segment.min_launches, launches);
                segment.max_launches = std::max(segment.max_launches, launches);
            }
            learned_.profile.cpu_time += segment.cpu_time;
            learned_.profile.segments.push_back(segment);
        }
    }

    const TraceView& view_;
    const TaskInstances& task_;
    LearnedTask learned_;
    std::map<Size, Samples> sizes_;
    std::vector<const Instance*> typical_;            ///< those of one shape
    std::map<Size, std::vector<OwnTime>> same_size_;  ///< positions that always have this size
};

}  // namespace

LearnedTask learn_task(const TraceView& view, const TaskInstances& task) {
    return TaskLearner(view, task).learn();
}

}  // namespace urgengo::trace
