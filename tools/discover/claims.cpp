// SPDX-License-Identifier: Apache-2.0
#include "tools/discover/claims.h"

#include <algorithm>
#include <tuple>

#include "tools/discover/names.h"

namespace urgengo::discover {
namespace {

using config::Task;
using trace::Segment;
using trace::TraceKind;
using trace::TraceRecord;

std::vector<const Task*> tasks_of(const config::Config& config) {
    std::vector<const Task*> tasks;
    for (const config::Chain& chain : config.chains) {
        for (const Task& task : chain.tasks) tasks.push_back(&task);
    }
    return tasks;
}

/// Whether a hint was in force on the thread, for each of its launches.
std::vector<bool> hinted_launches(const trace::ThreadTrace& thread) {
    std::vector<bool> hinted;
    bool in_force = false;
    for (const TraceRecord* event : thread.events) {
        if (event->kind == TraceKind::kTaskBegin) in_force = true;
        if (event->kind == TraceKind::kTaskEnd) in_force = false;
        if (event->kind == TraceKind::kLaunch) hinted.push_back(in_force);
    }
    return hinted;
}

/// What a task's rules say of launches: whether one of each kind holds. Remembered, since few
/// launches differ in what rules look at.
class RuleBook {
  public:
    RuleBook(const config::Config& config, const Observation& seen)
        : tasks_(tasks_of(config)), seen_(seen) {}

    struct Match {
        bool thread = false, nvtx = false, kernels = false;  ///< there is a rule, and it holds
        bool all = false;                                    ///< of the rules that there are
    };

    const std::vector<Match>& of(std::size_t thread, std::size_t index) {
        const abi::TraceLaunch& launch = seen_.launch(thread, index).launch;
        const Key key{std::string(seen_.thread_name(thread, index)), seen_.ranges[thread].at(index),
                      launch.name_hash, launch.grid_blocks, launch.block_threads};
        const auto known = known_.find(key);
        if (known != known_.end()) return known->second;
        std::vector<Match> matches;
        for (const Task* task : tasks_) matches.push_back(match(*task, key));
        return known_.emplace(key, std::move(matches)).first->second;
    }

  private:
    using Key = std::tuple<std::string, std::vector<std::uint64_t>, std::uint64_t, std::uint32_t,
                           std::uint32_t>;

    Match match(const Task& task, const Key& key) const {
        const auto& [thread_name, ranges, hash, grid_blocks, block_threads] = key;
        Match match;
        match.thread = !task.thread_glob.empty() && matches_glob(task.thread_glob, thread_name);
        match.nvtx = !task.nvtx_glob.empty() &&
                     std::any_of(ranges.begin(), ranges.end(), [&](std::uint64_t range) {
                         return matches_glob(task.nvtx_glob, seen_.trace.text(range));
                     });
        for (const config::KernelPattern& pattern : task.kernels) {
            const bool fits =
                (pattern.grid_blocks == 0 || pattern.grid_blocks == std::get<3>(key)) &&
                (pattern.block_threads == 0 || pattern.block_threads == std::get<4>(key));
            match.kernels =
                match.kernels ||
                (fits && matches_glob(pattern.name_glob, seen_.trace.text(std::get<2>(key))));
        }
        const bool has_rule =
            !task.thread_glob.empty() || !task.nvtx_glob.empty() || !task.kernels.empty();
        match.all = has_rule && (task.thread_glob.empty() || match.thread) &&
                    (task.nvtx_glob.empty() || match.nvtx) &&
                    (task.kernels.empty() || match.kernels);
        return match;
    }

    const std::vector<const Task*> tasks_;
    const Observation& seen_;
    std::map<Key, std::vector<Match>> known_;
};

/// @param has_begun  a kernel of the task's has been launched on the thread
MatchedBy matched_by(const Task& task, const RuleBook::Match& match, bool hinted, bool has_begun) {
    if (hinted) return MatchedBy::kHint;
    if (match.nvtx) return MatchedBy::kNvtx;
    if (!task.kernels.empty() && has_begun) return MatchedBy::kKernels;
    if (match.thread && task.kernels.empty() && task.nvtx_glob.empty()) return MatchedBy::kThread;
    return MatchedBy::kStream;
}

void add_unexplained(const Observation& seen, const Segment& segment, Claims& claims) {
    for (std::size_t i = 0; i < segment.num_launches; ++i) {
        const std::size_t index = segment.first_launch + i;
        Unexplained& group =
            claims.unexplained[std::string(seen.thread_name(segment.thread, index))];
        const std::int64_t gpu_ns = seen.gpu_ns(segment.thread, index);
        const std::string name = trace::launch_name(seen.trace, seen.launch(segment.thread, index));
        ++group.launches;
        group.gpu_ns += gpu_ns;
        group.kernels[short_kernel_name(name)] += gpu_ns;
    }
}

void add_thread(const std::vector<const Task*>& tasks, const Observation& seen, std::size_t thread,
                RuleBook& rules, Claims& claims) {
    const std::vector<bool> hinted = hinted_launches(seen.trace.threads()[thread]);
    std::vector<bool> has_begun(tasks.size());
    for (const Segment& segment : seen.segments[thread]) {
        ++claims.first_kernels[trace::launch_name(seen.trace, *segment.first)];
        if (segment.task < 0 || static_cast<std::size_t>(segment.task) >= tasks.size()) {
            add_unexplained(seen, segment, claims);
        }
        for (std::size_t i = 0; i < segment.num_launches; ++i) {
            const std::size_t index = segment.first_launch + i;
            ++claims.thread_names[std::string(seen.thread_name(thread, index))];
            for (const std::uint64_t range : seen.ranges[thread].at(index)) {
                ++claims.range_names[std::string(seen.trace.text(range))];
            }
            const std::vector<RuleBook::Match>& matches = rules.of(thread, index);
            for (std::size_t t = 0; t < tasks.size(); ++t) {
                if (matches[t].kernels) has_begun[t] = true;
                const bool is_double =
                    segment.task >= 0 && static_cast<int>(t) != segment.task && matches[t].all;
                if (is_double) ++claims.doubles[{segment.task, static_cast<int>(t)}];
            }
            if (segment.task < 0 || static_cast<std::size_t>(segment.task) >= tasks.size())
                continue;
            const auto its = static_cast<std::size_t>(segment.task);
            TaskClaims& task = claims.tasks[its];
            ++task.launches;
            task.gpu_ns += seen.gpu_ns(thread, index);
            ++task.by[static_cast<std::size_t>(
                matched_by(*tasks[its], matches[its], hinted[index], has_begun[its]))];
        }
    }
}

}  // namespace

const char* matched_by_name(MatchedBy by) {
    switch (by) {
        case MatchedBy::kHint:
            return "hint";
        case MatchedBy::kNvtx:
            return "nvtx";
        case MatchedBy::kKernels:
            return "kernels";
        case MatchedBy::kThread:
            return "thread";
        case MatchedBy::kStream:
            break;
    }
    return "stream";
}

Claims find_claims(const config::Config& config, const Observation& seen) {
    Claims claims;
    claims.total_gpu_ns = seen.total_gpu_ns();
    int index = 0;
    for (const config::Chain& chain : config.chains) {
        for (const Task& task : chain.tasks) {
            TaskClaims its;
            its.chain = chain.name;
            its.name = task.name;
            its.period = chain.period;
            its.instances =
                trace::find_instances(trace::segments_of(seen.segments, index++), chain.period);
            claims.tasks.push_back(std::move(its));
        }
    }
    RuleBook rules(config, seen);
    const std::vector<const Task*> tasks = tasks_of(config);
    for (std::size_t thread = 0; thread < seen.segments.size(); ++thread) {
        add_thread(tasks, seen, thread, rules, claims);
    }
    return claims;
}

bool all_matched(const Claims& claims) {
    return std::all_of(claims.tasks.begin(), claims.tasks.end(),
                       [](const TaskClaims& task) { return task.launches > 0; });
}

}  // namespace urgengo::discover
