// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/task_pieces.h"

#include <algorithm>

#include "host/base/memory_orders.h"

namespace urgengo::runtime {
namespace {

/// The oldest first. @param from  no more than one earlier one is asked for
std::vector<observe::LaunchedWork> launches_since(const model::LaunchLog& log, nanoseconds from) {
    const std::uint32_t count = log.count();
    std::vector<observe::LaunchedWork> launches;
    for (std::uint32_t i = 1; i < model::LaunchLog::kReadable; ++i) {
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

TaskPieces::TaskPieces(const TaskState& task, nanoseconds from, nanoseconds now)
    : now_(now), next_(next_mark(task)), launches_(launches_since(task.log, from)) {
    task.facts.executed.for_each([&](const model::ExecutedPoints::Point& point) {
        if (point.time >= from) points_.push_back({point.time, point.work});
    });
    // Nothing is launched while its thread is held.
    task.facts.holds.for_each([&](const HoldSpans::Hold& hold) {
        observe::put_behind_gate(launches_, hold.begin, hold.end);
    });
}

std::vector<observe::ExecutedPiece> TaskPieces::of(const GpuWindows::Segment& segment) const {
    using End = observe::WorkSegment::End;
    const bool is_over = segment.end.count() != 0;
    return observe::pieces_of({.begin = segment.begin,
                               .end = is_over ? segment.end : now_,
                               .first_work = segment.first_work,
                               .last_work = is_over ? segment.last_work : next_,
                               .how_ends = !is_over              ? End::kOpen
                                           : segment.is_executed ? End::kExecuted
                                                                 : End::kLeft},
                              points_, launches_);
}

}  // namespace urgengo::runtime
