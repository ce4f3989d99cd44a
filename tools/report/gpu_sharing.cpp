// SPDX-License-Identifier: Apache-2.0
#include "tools/report/gpu_sharing.h"

#include <algorithm>
#include <limits>
#include <map>
#include <numeric>
#include <span>

#include "tools/trace/collision.h"

namespace urgengo::report {
namespace {

using Kind = trace::RunSlice::Kind;

constexpr std::int64_t kNoDeadline = std::numeric_limits<std::int64_t>::max();

/// What changes at a time.
struct Change {
    enum class Kind { kSegment, kHold, kPriority };
    std::int64_t time_ns;
    Kind kind;
    std::size_t task;
    int by;  ///< of segments and holds under way: +1, -1; of a priority: the new one
    std::int64_t deadline_ns;  ///< of a segment's frame
};

struct TaskNow {
    int segments = 0, holds = 0, priority = 0;
    std::int64_t deadline_ns = kNoDeadline;

    bool is_on_gpu() const { return segments > 0 && holds == 0; }
};

std::vector<Change> changes_of(const trace::Run& run, const trace::RunStory& story) {
    std::vector<Change> changes;
    for (const trace::RunSlice& slice : story.slices) {
        if (slice.kind != Kind::kSegment && slice.kind != Kind::kHold) continue;
        const bool is_segment = slice.kind == Kind::kSegment;
        // The thread of a launch behind a gate goes on, and what it launched before may execute.
        if (!is_segment && (slice.flags & abi::kRunGate)) continue;
        const auto kind = is_segment ? Change::Kind::kSegment : Change::Kind::kHold;
        std::int64_t deadline_ns = kNoDeadline;
        if (is_segment && slice.frame != trace::kNoFrame)
            deadline_ns =
                story.frames[slice.frame].arrival_ns + run.chains[slice.chain].deadline_ns;
        changes.push_back({slice.begin_ns, kind, slice.task, 1, deadline_ns});
        changes.push_back({slice.end_ns, kind, slice.task, -1, deadline_ns});
    }
    for (const trace::RunRecord& point : story.points)
        if (point.kind == trace::RunKind::kPriority)
            changes.push_back({point.time_ns, Change::Kind::kPriority,
                               static_cast<std::size_t>(point.task), point.priority.now,
                               kNoDeadline});
    std::stable_sort(changes.begin(), changes.end(),
                     [](const Change& a, const Change& b) { return a.time_ns < b.time_ns; });
    return changes;
}

void apply(const Change& change, TaskNow& task) {
    switch (change.kind) {
        case Change::Kind::kPriority:
            task.priority = change.by;
            return;
        case Change::Kind::kHold:
            task.holds += change.by;
            return;
        case Change::Kind::kSegment:
            task.segments += change.by;
            if (change.by > 0) task.deadline_ns = change.deadline_ns;
            return;
    }
}

/// @returns the chains on the GPU
std::vector<trace::ChainOnGpu> chains_on_gpu(const trace::Run& run,
                                             std::span<const TaskNow> tasks) {
    std::map<std::size_t, trace::ChainOnGpu> chains;
    for (std::size_t i = 0; i < tasks.size(); ++i) {
        if (!tasks[i].is_on_gpu()) continue;
        const auto [found, is_new] = chains.try_emplace(
            run.tasks[i].chain, trace::ChainOnGpu{tasks[i].deadline_ns, tasks[i].priority});
        if (!is_new && tasks[i].deadline_ns < found->second.deadline_ns)
            found->second = {tasks[i].deadline_ns, tasks[i].priority};
    }
    std::vector<trace::ChainOnGpu> all;
    for (const auto& entry : chains) all.push_back(entry.second);
    return all;
}

}  // namespace

GpuSharing gpu_sharing(const trace::Run& run, const trace::RunStory& story) {
    GpuSharing sharing;
    sharing.by_chains_ns.assign(run.chains.size() + 1, 0);
    sharing.collisions_ns.assign(run.chains.size() + 1, 0);
    sharing.span_ns = run.last_ns() - run.first_ns();
    for (const trace::RunSlice& slice : story.slices)
        if (slice.kind == Kind::kSegment) {
            sharing.is_known = true;
            sharing.planned_ns += slice.estimate_ns;
        }
    std::vector<TaskNow> tasks(run.tasks.size());
    std::int64_t since_ns = run.first_ns();
    std::size_t on_gpu = 0, colliding = 0;
    const auto pass = [&](std::int64_t until_ns) {
        until_ns = std::clamp(until_ns, since_ns, std::max(since_ns, run.last_ns()));
        sharing.by_chains_ns[on_gpu] += until_ns - since_ns;
        if (colliding > 0) sharing.collisions_ns[colliding] += until_ns - since_ns;
        since_ns = until_ns;
    };
    const std::vector<Change> changes = changes_of(run, story);
    for (std::size_t i = 0; i < changes.size();) {
        const std::int64_t now_ns = changes[i].time_ns;
        pass(now_ns);
        for (; i < changes.size() && changes[i].time_ns == now_ns; ++i)
            apply(changes[i], tasks[changes[i].task]);
        const std::vector<trace::ChainOnGpu> chains = chains_on_gpu(run, tasks);
        const std::vector<bool> collide = trace::colliding(chains);
        on_gpu = chains.size();
        colliding = static_cast<std::size_t>(std::count(collide.begin(), collide.end(), true));
    }
    pass(run.last_ns());
    return sharing;
}

double GpuSharing::busy_share() const {
    if (span_ns <= 0 || by_chains_ns.empty()) return 0;
    return 1 - static_cast<double>(by_chains_ns[0]) / static_cast<double>(span_ns);
}

double GpuSharing::collision_share() const {
    if (span_ns <= 0) return 0;
    const std::int64_t all =
        std::accumulate(collisions_ns.begin(), collisions_ns.end(), std::int64_t{0});
    return static_cast<double>(all) / static_cast<double>(span_ns);
}

}  // namespace urgengo::report
