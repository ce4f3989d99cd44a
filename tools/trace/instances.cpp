// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/instances.h"

#include <algorithm>
#include <map>
#include <tuple>

#include "tools/trace/median.h"
#include "tools/trace/repeating_unit.h"

namespace urgengo::trace {
namespace {

using std::chrono::nanoseconds;
using Segments = std::vector<Segment>;
using Instances = std::vector<Instance>;

/// A unit that takes less than this share of the chain's period may be a part of an instance.
constexpr double kPartOfPeriod = 0.6;
/// Bursts are preferred to such a unit if they come this close to the period.
constexpr double kPeriodTolerance = 0.25;
/// Two instances at the begin this much faster or slower than usual are start-up.
constexpr double kTooFast = 0.5;
constexpr double kTooSlow = 4;
/// What a program does in the last third of its time tells what it repeats, if that is enough:
/// before, it may make its model, in thousands of small segments (a network's weights, one by one).
constexpr std::int64_t kSteadyPart = 3;
constexpr std::size_t kEnoughSegments = 12;

std::uint64_t combine(std::uint64_t hash, std::uint64_t value) {
    return (hash ^ value) * 0x9e3779b97f4a7c15u ^ hash >> 29;
}

UnitSegment unit_segment(const Segment& segment) {
    const abi::TraceLaunch& first = segment.first->launch;
    const std::uint64_t wait =
        segment.closed_by ? 1 + static_cast<std::uint64_t>(segment.closed_by->wait.function) : 0;
    UnitSegment unit;
    const std::uint64_t loosest = combine(combine(1, first.name_hash), wait);
    const std::uint64_t counted = combine(loosest, segment.num_launches);
    const std::uint64_t strict = combine(combine(counted, first.grid_blocks), first.block_threads);
    unit.types = {strict, counted, loosest};
    unit.begin_ns = segment.begin_ns;
    unit.idle_ns = segment.idle_ns;
    unit.gap_ns = segment.gap_ns;
    unit.begins_task = segment.begins_task;
    return unit;
}

UnitSequence unit_sequence(const Segments& segments) {
    UnitSequence sequence;
    std::transform(segments.begin(), segments.end(), std::back_inserter(sequence), unit_segment);
    return sequence;
}

std::size_t count_launches(const Segments& segments) {
    std::size_t count = 0;
    for (const Segment& segment : segments) count += segment.num_launches;
    return count;
}

Instance make_instance(Segments segments) {
    Instance instance;
    instance.begin_ns = segments.front().begin_ns;
    instance.num_launches = count_launches(segments);
    instance.segments = std::move(segments);
    return instance;
}

Instances from_spans(const Segments& segments, const std::vector<UnitSpan>& spans) {
    Instances instances;
    for (const UnitSpan& span : spans) {
        const auto begin = segments.begin() + static_cast<std::ptrdiff_t>(span.begin);
        instances.push_back(
            make_instance(Segments(begin, begin + static_cast<std::ptrdiff_t>(span.count))));
    }
    return instances;
}

/// Segments of one instance may be on several threads; it counts as the first one's.
/// @returns the instances of each thread, in time order
std::vector<Instances> known_instances(const std::vector<Segments>& threads) {
    std::map<std::uint64_t, Segments> by_instance;
    for (const Segments& segments : threads) {
        for (const Segment& segment : segments) {
            if (segment.instance != 0) by_instance[segment.instance].push_back(segment);
        }
    }
    std::map<std::size_t, Instances> by_thread;
    for (auto& [id, segments] : by_instance) {
        std::stable_sort(segments.begin(), segments.end(),
                         [](const auto& a, const auto& b) { return a.begin_ns < b.begin_ns; });
        Instance instance = make_instance(std::move(segments));
        by_thread[instance.segments[0].thread].push_back(std::move(instance));
    }
    std::vector<Instances> result;
    for (auto& [thread, instances] : by_thread) result.push_back(std::move(instances));
    return result;
}

bool close_to_period(std::int64_t spacing_ns, nanoseconds period) {
    const double ratio = static_cast<double>(spacing_ns) / static_cast<double>(period.count());
    return ratio > 1 - kPeriodTolerance && ratio < 1 + kPeriodTolerance;
}

/// Every segment is an instance.
std::vector<UnitSpan> single_spans(const UnitSequence& sequence) {
    std::vector<UnitSpan> spans;
    for (std::size_t i = 0; i < sequence.size(); ++i) spans.push_back({i, 1});
    return spans;
}

UnitSequence steady_part(const UnitSequence& sequence) {
    if (sequence.empty()) return sequence;
    const std::int64_t end_ns = sequence.back().begin_ns;
    const std::int64_t from_ns = end_ns - (end_ns - sequence.front().begin_ns) / kSteadyPart;
    const auto from = std::find_if(sequence.begin(), sequence.end(),
                                   [&](const UnitSegment& s) { return s.begin_ns >= from_ns; });
    const UnitSequence steady(from, sequence.end());
    return steady.size() < kEnoughSegments ? sequence : steady;
}

struct Learned {
    Boundaries boundaries = Boundaries::kNone;
    std::vector<std::vector<UnitSpan>> spans;  ///< of each thread
};

Learned learn(const std::vector<UnitSequence>& sequences, nanoseconds period) {
    Learned by_unit, by_gaps, single;
    std::vector<UnitSequence> steady;
    for (const UnitSequence& sequence : sequences) steady.push_back(steady_part(sequence));
    const auto unit = find_unit(steady, period.count());
    bool may_be_part = false, gaps_fit = false;
    for (const UnitSequence& sequence : sequences) {
        single.spans.push_back(single_spans(sequence));
        by_gaps.spans.push_back(find_bursts(sequence, period.count()));
        if (!by_gaps.spans.back().empty()) by_gaps.boundaries = Boundaries::kBursts;
        const std::int64_t gaps_ns = median_spacing_ns(sequence, by_gaps.spans.back());
        gaps_fit = gaps_fit || (period.count() > 0 && close_to_period(gaps_ns, period));
        if (!unit) continue;
        by_unit.boundaries = Boundaries::kRepeating;
        by_unit.spans.push_back(find_spans(sequence, *unit));
        const std::int64_t unit_ns = median_spacing_ns(sequence, by_unit.spans.back());
        may_be_part =
            may_be_part || (unit_ns > 0 && static_cast<double>(unit_ns) <
                                               kPartOfPeriod * static_cast<double>(period.count()));
    }
    // On several threads of one task, each serves only some of the frames: only one alone tells.
    const bool is_part = sequences.size() == 1 && may_be_part && gaps_fit;
    if (unit && !is_part) return by_unit;
    return by_gaps.boundaries == Boundaries::kBursts ? by_gaps : single;
}

/// The launch counts that instances have once the program runs steadily.
struct CountRange {
    std::size_t min = SIZE_MAX, max = 0;

    bool contains(std::size_t count) const { return count >= min && count <= max; }
};

CountRange steady_counts(const Instances& instances) {
    CountRange range;
    for (std::size_t i = instances.size() / 3; i < instances.size(); ++i) {
        // The last one may have been cut short by the program's end.
        if (i + 1 == instances.size() && i > instances.size() / 3) continue;
        range.min = std::min(range.min, instances[i].num_launches);
        range.max = std::max(range.max, instances[i].num_launches);
    }
    return range;
}

std::int64_t median_spacing_ns(const Instances& instances) {
    std::vector<std::int64_t> spacings;
    for (std::size_t i = 1; i < instances.size(); ++i) {
        spacings.push_back(instances[i].begin_ns - instances[i - 1].begin_ns);
    }
    return spacings.empty() ? 0 : median(spacings);
}

/// Removes start-up from the begin, and an instance that the program's end cut short.
void trim(Instances& instances) {
    if (instances.size() < 3) return;
    const CountRange counts = steady_counts(instances);
    const auto usual = static_cast<double>(median_spacing_ns(instances));
    std::size_t first = 0;
    for (; first < instances.size() / 2; ++first) {
        const auto spacing =
            static_cast<double>(instances[first + 1].begin_ns - instances[first].begin_ns);
        const bool steady = counts.contains(instances[first].num_launches) &&
                            spacing > kTooFast * usual && spacing < kTooSlow * usual;
        if (steady) break;
    }
    if (instances.back().num_launches < counts.min) instances.pop_back();
    instances.erase(instances.begin(), instances.begin() + static_cast<std::ptrdiff_t>(first));
}

/// @returns launches of `segments` before the first of `instances`, which are of the same thread
std::size_t launches_before(const Segments& segments, const Instances& instances) {
    std::size_t count = 0;
    for (const Segment& segment : segments) {
        if (!instances.empty() && segment.begin_ns >= instances.front().begin_ns) break;
        count += segment.num_launches;
    }
    return count;
}

}  // namespace

std::string_view boundaries_name(Boundaries boundaries) {
    switch (boundaries) {
        case Boundaries::kKnown:
            return "hints or ranges";
        case Boundaries::kRepeating:
            return "repeating segments";
        case Boundaries::kBursts:
            return "idle gaps";
        case Boundaries::kNone:
            break;
    }
    return "not found";
}

TaskInstances find_instances(const std::vector<Segments>& segments, nanoseconds period) {
    TaskInstances task;
    std::vector<Instances> threads = known_instances(segments);
    if (!threads.empty()) {
        task.boundaries = Boundaries::kKnown;
    } else {
        std::vector<UnitSequence> sequences;
        for (const Segments& list : segments) sequences.push_back(unit_sequence(list));
        const Learned learned = learn(sequences, period);
        task.boundaries = learned.boundaries;
        for (std::size_t i = 0; i < segments.size(); ++i) {
            threads.push_back(from_spans(segments[i], learned.spans[i]));
        }
    }
    std::map<std::size_t, const Instances*> by_thread;
    for (Instances& instances : threads) {
        trim(instances);
        if (!instances.empty()) by_thread[instances[0].segments[0].thread] = &instances;
    }
    std::size_t in_instances = 0;
    for (const Segments& list : segments) {
        task.num_launches += count_launches(list);
        const auto it = by_thread.find(list.empty() ? SIZE_MAX : list[0].thread);
        task.start_up_launches +=
            launches_before(list, it == by_thread.end() ? Instances{} : *it->second);
    }
    for (Instances& instances : threads) {
        for (Instance& instance : instances) {
            in_instances += instance.num_launches;
            task.instances.push_back(std::move(instance));
        }
    }
    task.irregular_launches =
        task.num_launches - std::min(task.num_launches, in_instances + task.start_up_launches);
    std::stable_sort(task.instances.begin(), task.instances.end(),
                     [](const auto& a, const auto& b) { return a.begin_ns < b.begin_ns; });
    task.period_ns = median_spacing_ns(task.instances);
    return task;
}

std::vector<Segments> segments_of(const std::vector<Segments>& segments, int task) {
    std::vector<Segments> result;
    for (const Segments& list : segments) {
        Segments own;
        std::copy_if(list.begin(), list.end(), std::back_inserter(own),
                     [task](const Segment& segment) { return segment.task == task; });
        if (!own.empty()) result.push_back(std::move(own));
    }
    return result;
}

}  // namespace urgengo::trace
