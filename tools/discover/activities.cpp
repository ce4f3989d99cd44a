// SPDX-License-Identifier: Apache-2.0
#include "tools/discover/activities.h"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <string>

namespace urgengo::discover {
namespace {

using trace::Instance;
using trace::Segment;

/// A thread that is off the CPU this long has waited for something.
constexpr std::int64_t kSleepNs = 200'000;
/// Spacings this close to their median are regular ones.
constexpr double kTolerance = 0.3;
/// So many of them must be: half is what a loaded program still shows; of Poisson arrivals it is a
/// fifth.
constexpr double kRegular = 0.5;
constexpr double kVeryRegular = 0.8;
/// A type of segment begins frames if the thread slept before this share of them.
constexpr double kStarterShare = 0.5;
/// So much of what a thread launches once it is running must be in frames.
constexpr double kMinCoverage = 0.6;
/// A gap before a frame at the begin that is this much longer than usual ends the start-up.
constexpr double kLongGap = 4;
/// Ranges tell segments apart if there are at most so many different ones.
constexpr std::size_t kMaxRangeTypes = 16;

std::uint64_t combine(std::uint64_t hash, std::uint64_t value) {
    return (hash ^ value) * 0x9e3779b97f4a7c15u ^ hash >> 29;
}

std::uint64_t kernel_type(const Segment& segment) {
    const abi::TraceLaunch& first = segment.first->launch;
    return combine(combine(combine(1, first.name_hash), first.grid_blocks), first.block_threads);
}

/// The types of a thread's segments.
std::vector<std::uint64_t> types_of(const std::vector<Segment>& segments,
                                    const RangeStacks& ranges) {
    std::vector<std::uint64_t> by_range, by_kernel;
    std::map<std::uint64_t, std::size_t> counts;
    for (const Segment& segment : segments) {
        by_kernel.push_back(kernel_type(segment));
        const auto& stack = ranges.at(segment.first_launch);
        by_range.push_back(stack.empty() ? 0 : combine(2, stack.front()));
        if (!stack.empty()) ++counts[by_range.back()];
    }
    const auto in_ranges = static_cast<std::size_t>(
        std::count_if(by_range.begin(), by_range.end(), [](auto type) { return type != 0; }));
    const bool tell = in_ranges * 10 >= segments.size() * 9 && counts.size() <= kMaxRangeTypes;
    return tell ? by_range : by_kernel;
}

std::vector<double> spacings(const std::vector<Instance>& frames) {
    std::vector<double> result;
    for (std::size_t i = 1; i < frames.size(); ++i) {
        result.push_back(static_cast<double>(frames[i].begin_ns - frames[i - 1].begin_ns));
    }
    return result;
}

double frame_regularity(const std::vector<Instance>& frames) {
    return frames.size() < kMinFrames ? 0 : regularity(spacings(frames), kTolerance);
}

/// Frames that may be an activity, or part of one.
struct Cluster {
    std::size_t thread = 0;
    std::uint64_t type = 0;
    std::vector<Instance> frames;
    bool is_alone = false;
    std::size_t start_up_launches = 0;
};

/// One thread, taken apart.
class ThreadFrames {
  public:
    ThreadFrames(const Observation& observation, std::size_t thread)
        : thread_(thread),
          segments_(observation.segments[thread]),
          types_(types_of(segments_, observation.ranges[thread])) {}

    std::vector<Cluster> run() {
        if (segments_.empty()) return {};
        std::optional<Cluster> whole = as_one();
        find_starters();
        std::vector<Cluster> parts = cut_at_starters();
        if (whole && !is_several(parts, whole->frames)) return {std::move(*whole)};
        if (parts.empty() && whole) return {std::move(*whole)};
        return parts;
    }

  private:
    /// The thread as one activity; nothing if that is not regular.
    std::optional<Cluster> as_one() {
        trace::TaskInstances found =
            trace::find_instances({segments_}, std::chrono::nanoseconds(0));
        if (found.boundaries == trace::Boundaries::kNone && segments_.size() < kMinFrames)
            return {};
        const std::size_t running = found.num_launches - found.start_up_launches;
        const auto covered = static_cast<double>(running - found.irregular_launches);
        if (covered < kMinCoverage * static_cast<double>(running)) return {};
        if (frame_regularity(found.instances) < kRegular) return {};
        Cluster cluster{thread_, 0, std::move(found.instances), true, found.start_up_launches};
        cluster.type = type_at(cluster.frames[cluster.frames.size() / 2].begin_ns);
        return cluster;
    }

    std::uint64_t type_at(std::int64_t begin_ns) const {
        const auto segment = std::lower_bound(
            segments_.begin(), segments_.end(), begin_ns,
            [](const Segment& s, std::int64_t time_ns) { return s.begin_ns < time_ns; });
        return types_[static_cast<std::size_t>(segment - segments_.begin())];
    }

    void find_starters() {
        std::map<std::uint64_t, std::pair<std::size_t, std::size_t>> counts;  // slept before, all
        for (std::size_t i = 0; i < segments_.size(); ++i) {
            auto& [slept, all] = counts[types_[i]];
            slept += segments_[i].idle_ns >= kSleepNs ? 1 : 0;
            ++all;
        }
        for (const auto& [type, count] : counts) {
            const auto share = static_cast<double>(count.first) / static_cast<double>(count.second);
            if (count.second >= 2 && share >= kStarterShare) starters_.insert(type);
        }
    }

    /// @returns one cluster for each type that the thread sleeps before
    std::vector<Cluster> cut_at_starters() const {
        std::map<std::uint64_t, Cluster> by_type;
        std::vector<Segment> open;
        std::uint64_t open_type = 0;
        const auto close = [&] {
            if (open.empty()) return;
            Cluster& cluster = by_type[open_type];
            cluster.thread = thread_;
            cluster.type = open_type;
            cluster.frames.push_back({open.front().begin_ns, 0, std::move(open)});
            for (const Segment& segment : cluster.frames.back().segments) {
                cluster.frames.back().num_launches += segment.num_launches;
            }
            open.clear();
        };
        std::size_t before_first = 0;
        for (std::size_t i = 0; i < segments_.size(); ++i) {
            if (starters_.count(types_[i])) {
                close();
                open_type = types_[i];
            } else if (open.empty()) {
                before_first += segments_[i].num_launches;
                continue;
            }
            open.push_back(segments_[i]);
        }
        close();
        std::vector<Cluster> clusters;
        for (auto& [type, cluster] : by_type) {
            cluster.is_alone = by_type.size() == 1;
            cluster.start_up_launches = before_first + drop_start_up(cluster.frames);
            clusters.push_back(std::move(cluster));
        }
        return clusters;
    }

    /// @returns the launches dropped
    static std::size_t drop_start_up(std::vector<Instance>& frames) {
        if (frames.size() < kMinFrames) return 0;
        const std::vector<double> gaps = spacings(frames);
        const double usual = spread_of(gaps).median;
        std::size_t first = 0;
        for (std::size_t i = 0; i < gaps.size() / 2; ++i) {
            if (gaps[i] > kLongGap * usual) first = i + 1;
        }
        std::size_t launches = 0;
        for (std::size_t i = 0; i < first; ++i) launches += frames[i].num_launches;
        frames.erase(frames.begin(), frames.begin() + static_cast<std::ptrdiff_t>(first));
        return launches;
    }

    /// Whether a unit that repeats is more than one activity: its parts have rates of their own.
    static bool is_several(const std::vector<Cluster>& parts, const std::vector<Instance>& whole) {
        if (parts.size() < 2) return false;
        bool same_rate = true;
        for (const Cluster& part : parts) {
            if (frame_regularity(part.frames) < kVeryRegular) return false;
            const auto rate =
                static_cast<double>(part.frames.size()) / static_cast<double>(whole.size());
            same_rate = same_rate && rate > 0.8 && rate < 1.25;
        }
        return !same_rate;
    }

    const std::size_t thread_;
    const std::vector<Segment>& segments_;
    const std::vector<std::uint64_t> types_;
    std::set<std::uint64_t> starters_;
};

void sort_by_time(std::vector<Instance>& frames) {
    std::stable_sort(frames.begin(), frames.end(),
                     [](const auto& a, const auto& b) { return a.begin_ns < b.begin_ns; });
}

std::vector<double> spacings_by_thread(const std::vector<Instance>& frames) {
    std::map<std::size_t, std::int64_t> last;
    std::vector<double> result;
    for (const Instance& frame : frames) {
        const std::size_t thread = frame.segments.front().thread;
        if (const auto before = last.find(thread); before != last.end()) {
            result.push_back(static_cast<double>(frame.begin_ns - before->second));
        }
        last[thread] = frame.begin_ns;
    }
    return result;
}

void measure(Activity& activity) {
    const std::vector<double> together = spacings(activity.frames);
    const std::vector<double> apart = spacings_by_thread(activity.frames);
    activity.takes_turns =
        activity.threads.size() > 1 && (regularity(together, kTolerance) >= kVeryRegular ||
                                        regularity(apart, kTolerance) < kRegular);
    activity.period_ns = spread_of(activity.takes_turns ? together : apart);
    std::vector<double> idle;
    for (const Instance& frame : activity.frames) {
        idle.push_back(static_cast<double>(frame.segments.front().idle_ns));
    }
    const double usual = spread_of(idle).median;
    activity.idle_share = activity.period_ns.median > 0 ? usual / activity.period_ns.median : 0;
}

Activity make_activity(std::vector<Cluster*> clusters) {
    Activity activity;
    activity.is_alone = true;
    for (Cluster* cluster : clusters) {
        activity.type = cluster->type;
        activity.threads.push_back(cluster->thread);
        activity.is_alone = activity.is_alone && cluster->is_alone;
        activity.start_up_launches += cluster->start_up_launches;
        for (Instance& frame : cluster->frames) activity.frames.push_back(std::move(frame));
    }
    std::sort(activity.threads.begin(), activity.threads.end());
    sort_by_time(activity.frames);
    if (!activity.is_alone) activity.start_up_launches = 0;
    measure(activity);
    return activity;
}

/// Frames of one type that several threads of one name take turns at.
std::optional<std::vector<Instance>> taken_together(const std::vector<Cluster*>& clusters) {
    std::vector<Instance> frames;
    for (const Cluster* cluster : clusters) {
        frames.insert(frames.end(), cluster->frames.begin(), cluster->frames.end());
    }
    sort_by_time(frames);
    if (frame_regularity(frames) < kRegular) return {};
    return frames;
}

std::vector<Activity> join(const Observation& observation, std::vector<Cluster> clusters) {
    std::map<std::pair<std::string, std::uint64_t>, std::vector<Cluster*>> groups;
    for (Cluster& cluster : clusters) {
        const auto& first = cluster.frames.front().segments.front();
        const std::string name(observation.thread_name(first.thread, first.first_launch));
        groups[{name, cluster.type}].push_back(&cluster);
    }
    std::vector<Activity> activities;
    for (auto& [key, group] : groups) {
        std::vector<Cluster*> regular;
        for (Cluster* cluster : group) {
            if (frame_regularity(cluster->frames) >= kRegular) regular.push_back(cluster);
        }
        if (regular.size() < group.size() && taken_together(group)) {
            activities.push_back(make_activity(group));
            continue;
        }
        for (Cluster* cluster : regular) activities.push_back(make_activity({cluster}));
    }
    return activities;
}

std::int64_t gpu_ns(const Observation& observation, const Activity& activity) {
    std::int64_t sum = 0;
    for (const Instance& frame : activity.frames) {
        for (const Segment& segment : frame.segments) {
            for (std::size_t i = 0; i < segment.num_launches; ++i) {
                sum += observation.gpu_ns(segment.thread, segment.first_launch + i);
            }
        }
    }
    return sum;
}

void find_owners(const Observation& observation, Activities& activities) {
    activities.owners.clear();
    for (const auto& launches : observation.gpu) {
        activities.owners.emplace_back(launches.size(), kNoActivity);
    }
    for (std::size_t a = 0; a < activities.list.size(); ++a) {
        for (const std::size_t thread : activities.list[a].threads) {
            // Start-up, and frames that fit nothing.
            const int otherwise = activities.list[a].is_alone ? static_cast<int>(a) : kAnyActivity;
            for (int& owner : activities.owners[thread]) owner = otherwise;
        }
    }
    for (std::size_t a = 0; a < activities.list.size(); ++a) {
        for (const Instance& frame : activities.list[a].frames) {
            for (const Segment& segment : frame.segments) {
                for (std::size_t i = 0; i < segment.num_launches; ++i) {
                    activities.owners[segment.thread][segment.first_launch + i] =
                        static_cast<int>(a);
                }
            }
        }
    }
}

}  // namespace

Activities find_activities(const Observation& observation) {
    std::vector<Cluster> clusters;
    for (std::size_t thread = 0; thread < observation.segments.size(); ++thread) {
        for (Cluster& cluster : ThreadFrames(observation, thread).run()) {
            if (!cluster.frames.empty()) clusters.push_back(std::move(cluster));
        }
    }
    Activities activities;
    activities.list = join(observation, std::move(clusters));
    std::vector<std::pair<std::int64_t, std::size_t>> order;
    for (std::size_t i = 0; i < activities.list.size(); ++i) {
        order.emplace_back(-gpu_ns(observation, activities.list[i]), i);
    }
    std::sort(order.begin(), order.end());
    std::vector<Activity> sorted;
    for (const auto& [time, index] : order) sorted.push_back(std::move(activities.list[index]));
    activities.list = std::move(sorted);
    find_owners(observation, activities);
    return activities;
}

void merge(Activities& activities, std::size_t first, std::size_t second) {
    Activity& into = activities.list[first];
    Activity& from = activities.list[second];
    into.threads.insert(into.threads.end(), from.threads.begin(), from.threads.end());
    std::sort(into.threads.begin(), into.threads.end());
    into.threads.erase(std::unique(into.threads.begin(), into.threads.end()), into.threads.end());
    for (Instance& frame : from.frames) into.frames.push_back(std::move(frame));
    sort_by_time(into.frames);
    into.is_alone = into.is_alone && from.is_alone;
    into.start_up_launches += from.start_up_launches;
    measure(into);
    activities.list.erase(activities.list.begin() + static_cast<std::ptrdiff_t>(second));
    for (auto& owners : activities.owners) {
        for (int& owner : owners) {
            if (owner == static_cast<int>(second)) owner = static_cast<int>(first);
            if (owner > static_cast<int>(second)) --owner;
        }
    }
}

}  // namespace urgengo::discover
