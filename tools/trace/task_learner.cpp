// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/task_learner.h"

#include <algorithm>
#include <map>
#include <tuple>

#include "tools/trace/busy_time.h"
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
    std::vector<KernelSample> known;    ///< lengths are what the busy time grew by
    std::vector<KernelSample> lengths;  ///< the same launches, with their own
    double utilization = 0;             ///< summed
    std::size_t count = 0;
    const TraceRecord* any = nullptr;
    OwnTime time;

    double mean_utilization() const {
        return count == 0 ? 0 : utilization / static_cast<double>(count);
    }
};

/// A launch in its instance.
struct Placed {
    std::size_t position = 0;
    std::size_t thread = 0;
    const GpuInterval* interval = nullptr;
    std::int64_t share_ns = 0;  ///< of the instance's busy time
    std::uint32_t branch = 0;   ///< of the segment's streams, in the order of first use
};

/// Names and segments of an instance, not sizes.
using Shape = std::vector<std::uint64_t>;

class TaskLearner {
  public:
    TaskLearner(const TraceView& view, const TaskInstances& task) : view_(view), task_(task) {}

    LearnedTask learn() {
        learned_.profile.start_up_launches = static_cast<std::uint32_t>(task_.start_up_launches);
        place_launches();
        learned_.profile.instances = static_cast<std::uint32_t>(placed_.size());
        if (placed_.empty()) return learned_;
        collect_sizes();
        find_typical();
        learn_positions();
        learn_sizes();
        learn_segments();
        return learned_;
    }

  private:
    std::vector<Placed> place(const Instance& instance) const {
        std::vector<Placed> launches;
        BusyTime busy;
        for (const Segment& segment : instance.segments) {
            std::vector<std::uint64_t> streams;
            for (std::size_t i = 0; i < segment.num_launches; ++i) {
                const GpuInterval& interval =
                    view_.intervals[segment.thread][segment.first_launch + i];
                Placed placed{launches.size(), segment.thread, &interval, 0, 0};
                const std::uint64_t stream = interval.launch->launch.stream;
                const auto known = std::find(streams.begin(), streams.end(), stream);
                placed.branch = static_cast<std::uint32_t>(known - streams.begin());
                if (known == streams.end()) streams.push_back(stream);
                if (interval.known && interval.parts.empty()) {
                    placed.share_ns = busy.add(interval.begin_ns, interval.end_ns);
                }
                for (const Span& part : interval.parts) {
                    placed.share_ns += busy.add(part.begin_ns, part.end_ns);
                }
                launches.push_back(placed);
            }
        }
        return launches;
    }

    /// By CUPTI, an instance that lacks a record tells nothing of the others' shares either.
    void place_launches() {
        const bool by_cupti = view_.trace.header().kernel_times == abi::TraceTimes::kCupti;
        for (const Instance& instance : task_.instances) {
            std::vector<Placed> launches = place(instance);
            const bool whole = std::all_of(launches.begin(), launches.end(),
                                           [](const auto& each) { return each.interval->known; });
            if (by_cupti && !whole) {
                ++learned_.discarded_instances;
            } else {
                placed_.emplace(&instance, std::move(launches));
            }
        }
    }

    template <typename Each>
    void for_each_launch(const Instance& instance, Each&& each) const {
        for (const Placed& launch : placed_.at(&instance)) each(launch);
    }

    void add(Samples& samples, const Placed& launch) const {
        const GpuInterval& interval = *launch.interval;
        samples.any = interval.launch;
        samples.utilization += utilization_of(*interval.launch);
        ++samples.count;
        if (!interval.known) return;
        const double contention = view_.contention.of(launch.thread, interval);
        const bool shared = interval.shared > 1 || interval.loose;
        samples.known.push_back({launch.share_ns, contention, shared});
        samples.lengths.push_back({interval.length_ns(), contention, shared});
    }

    void collect_sizes() {
        for (const auto& [instance, launches] : placed_) {
            for (const Placed& each : launches) {
                add(sizes_[size_of(*each.interval->launch)], each);
            }
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
        for_each_launch(instance, [&](const Placed& each) {
            shape.push_back(each.interval->launch->launch.name_hash);
        });
        return shape;
    }

    void find_typical() {
        std::map<Shape, std::vector<const Instance*>> shapes;
        std::vector<std::size_t> counts;
        for (const Instance& instance : task_.instances) {
            if (placed_.count(&instance) == 0) continue;
            shapes[shape_of(instance)].push_back(&instance);
            counts.push_back(instance.num_launches);
        }
        const std::size_t usual = median(counts);
        const auto total = static_cast<double>(counts.size());
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
        std::vector<std::map<std::uint32_t, std::size_t>> branches(count);
        for (const Instance* instance : typical_) {
            for_each_launch(*instance, [&](const Placed& each) {
                add(positions[each.position], each);
                ++seen[each.position][size_of(*each.interval->launch)];
                ++branches[each.position][each.branch];
            });
        }
        for (std::size_t k = 0; k < count; ++k) {
            if (seen[k].size() == 1) {
                positions[k].time = own_time(positions[k].known);
                take_from_elsewhere(positions[k].time, sizes_.at(seen[k].begin()->first));
                same_size_[seen[k].begin()->first].push_back(positions[k].time);
            } else {
                take_mean(positions[k], seen[k]);
            }
            config::KernelProfile learned = kernel(positions[k]);
            learned.stream = most_frequent(branches[k]);
            add_to_sums(positions[k], learned);
            learned_.profile.kernels.push_back(std::move(learned));
        }
    }

    static std::uint32_t most_frequent(const std::map<std::uint32_t, std::size_t>& branches) {
        return std::max_element(branches.begin(), branches.end(),
                                [](const auto& a, const auto& b) { return a.second < b.second; })
            ->first;
    }

    void add_to_sums(const Samples& position, const config::KernelProfile& kernel) {
        // A launch's share of the busy time may be less than its length, never more.
        const nanoseconds own{own_time(position.lengths).ns};
        const nanoseconds length = std::max(own, kernel.gpu_time);
        learned_.sum += length;
        if (kernel.stream > 0) learned_.on_side_streams += length;
        learned_.streams = std::max(learned_.streams, kernel.stream + 1);
    }

    /// A position that was never seen without contention takes the time of the same kernel and size
    /// at positions that were: contention only lengthens.
    static void take_from_elsewhere(OwnTime& time, const Samples& elsewhere) {
        const bool clean = elsewhere.time.clean >= kMinCleanSamples;
        if (!clean || time.clean >= kMinCleanSamples) return;
        if (time.samples == 0 || elsewhere.time.ns < time.ns) time.ns = elsewhere.time.ns;
        time.samples = std::max(time.samples, elsewhere.time.samples);
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
    std::map<const Instance*, std::vector<Placed>> placed_;  ///< of instances that tell
    std::map<Size, Samples> sizes_;
    std::vector<const Instance*> typical_;            ///< those of one shape
    std::map<Size, std::vector<OwnTime>> same_size_;  ///< positions that always have this size
};

}  // namespace

LearnedTask learn_task(const TraceView& view, const TaskInstances& task) {
    return TaskLearner(view, task).learn();
}

}  // namespace urgengo::trace
