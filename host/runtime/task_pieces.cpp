// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/task_pieces.h"

#include <algorithm>

#include "host/base/memory_orders.h"

namespace urgengo::runtime {
namespace {

/// The oldest first. @param from  no more than one earlier one is asked for
std::vector<observe::LaunchedWork> launches_since(const model::LaunchLog& log, nanoseconds from,
                                                  std::uint32_t most_launches) {
    const std::uint32_t count = log.count();
    std::vector<observe::LaunchedWork> launches;
    const std::uint32_t last = std::min(most_launches, model::LaunchLog::kReadable - 1);
    for (std::uint32_t i = 1; i <= last; ++i) {
        const std::uint32_t n = count - i;
        launches.push_back({log.time(n), log.end(n - 1), log.end(n)});
        if (launches.back().time < from) break;  // that has never been is at 0
    }
    // The writer may have come round to the oldest.
    const std::size_t moved = log.count() - count;
    const std::size_t most = model::LaunchLog::kReadable - 1;
    launches.resize(std::min(launches.size(), most - std::min(moved, most)));
    std::reverse(launches.begin(), launches.end());
    return launches;
}

/// @returns work up to the first mark that was not seen executed; without one, all that is launched
nanoseconds next_mark(const TaskState& task) {
    const model::LaunchLog& log = task.log;
    const std::uint32_t next = task.slot->marks_done.load(kAcquire) + 1;
    const bool is_there = log.last_mark() + 1 != next;
    const std::uint32_t launches = is_there ? log.launches_before_mark(next) : log.count();
    return log.end(launches - 1);
}

}  // namespace

std::uint32_t TaskPieces::share_of(std::size_t num_tasks) {
    // With 255 others of 64 segments and 960 marks each a frame's account takes 1.1 ms on a 2-core
    // machine, and 130 ms if all is read.
    constexpr std::size_t kOfAllTasks = 10 * kAll;
    return static_cast<std::uint32_t>(
        std::min<std::size_t>(kOfAllTasks / std::max<std::size_t>(num_tasks, 1), kAll));
}

TaskPieces::TaskPieces(const TaskState& task, nanoseconds from, nanoseconds now, std::uint32_t most)
    : now_(now), next_(next_mark(task)), launches_(launches_since(task.log, from, most)) {
    task.facts.executed.for_each_of_last(task.slot->marks_done.load(kAcquire), most,
                                         [&](const model::ExecutedPoints::Point& point) {
                                             if (point.time >= from)
                                                 points_.push_back({point.time, point.work});
                                         });
    const auto by_work = [](const auto& a, const auto& b) { return a.work < b.work; };
    if (!std::is_sorted(points_.begin(), points_.end(), by_work))
        std::sort(points_.begin(), points_.end(), by_work);
    // Nothing is launched while its thread is held.
    task.facts.holds.for_each(
        [&](const HoldSpans::Hold& hold) {
            if (hold.end > from) observe::put_behind_gate(launches_, hold.begin, hold.end);
        },
        holds_of(most));
}

std::vector<observe::ExecutedPiece> TaskPieces::of(const GpuWindows::Segment& segment) const {
    using End = observe::WorkSegment::End;
    const bool is_over = segment.end.count() != 0;
    const nanoseconds last_work = is_over ? segment.last_work : next_;
    const auto is_within = [](nanoseconds work, const observe::ExecutedPoint& point) {
        return work < point.work;
    };
    const auto first =
        std::upper_bound(points_.begin(), points_.end(), segment.first_work, is_within);
    const auto behind = std::upper_bound(first, points_.end(), last_work, is_within);
    return observe::pieces_of({.begin = segment.begin,
                               .end = is_over ? segment.end : now_,
                               .first_work = segment.first_work,
                               .last_work = last_work,
                               .how_ends = !is_over              ? End::kOpen
                                           : segment.is_executed ? End::kExecuted
                                                                 : End::kLeft},
                              {first, behind}, launches_);
}

}  // namespace urgengo::runtime
