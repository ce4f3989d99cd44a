// SPDX-License-Identifier: Apache-2.0
#include "host/observe/executed_pieces.h"

#include <algorithm>

namespace urgengo::observe {
namespace {

/// @returns for how long the GPU waited for the launches between two points, at the plan's pace
nanoseconds idle_between(const ExecutedPoint& from, const ExecutedPoint& to,
                         const std::vector<LaunchedWork>& launches) {
    const auto is_executed = [](const LaunchedWork& launch, nanoseconds work) {
        return launch.end <= work;
    };
    nanoseconds idle{0}, time = from.time, work = from.work;
    for (auto launch = std::lower_bound(launches.begin(), launches.end(), from.work, is_executed);
         launch != launches.end() && launch->begin < to.work; ++launch) {
        time += std::max(launch->begin - work, nanoseconds{0});  // launches that are not known
        if (launch->time > time) {
            idle += launch->time - time;
            time = launch->time;
        }
        time += launch->end - std::max(launch->begin, work);
        work = launch->end;
    }
    return idle;
}

}  // namespace

void put_behind_gate(std::vector<LaunchedWork>& launches, nanoseconds begin, nanoseconds end) {
    const auto is_before = [](const LaunchedWork& launch, nanoseconds time) {
        return launch.time < time;
    };
    for (auto launch = std::lower_bound(launches.begin(), launches.end(), begin, is_before);
         launch != launches.end() && launch->time < end; ++launch)
        launch->time = end;
}

nanoseconds took(const std::vector<ExecutedPiece>& pieces) {
    nanoseconds time{0};
    for (const ExecutedPiece& piece : pieces) time += piece.took();
    return time;
}

void join(std::vector<ExecutedPiece>& pieces, std::size_t most) {
    if (pieces.size() <= most) return;
    const std::size_t each = (pieces.size() + most - 1) / most;
    std::size_t num = 0;
    for (std::size_t i = 0; i < pieces.size(); ++i) {
        if (i % each == 0) {
            pieces[num++] = pieces[i];
            continue;
        }
        ExecutedPiece& all = pieces[num - 1];
        const ExecutedPiece& next = pieces[i];
        all.idle += next.idle + std::max(next.begin - all.end, nanoseconds{0});
        all.end = std::max(all.end, next.end);
        all.work += next.work;
        all.is_open = next.is_open;
    }
    pieces.resize(num);
}

std::vector<ExecutedPiece> pieces_of(const WorkSegment& segment, std::vector<ExecutedPoint> points,
                                     const std::vector<LaunchedWork>& launches) {
    const auto is_of_another = [&](const ExecutedPoint& point) {
        return point.time <= segment.begin || point.work <= segment.first_work ||
               point.work > segment.last_work;
    };
    points.erase(std::remove_if(points.begin(), points.end(), is_of_another), points.end());
    if (segment.how_ends == WorkSegment::End::kExecuted) {
        for (ExecutedPoint& point : points) point.time = std::min(point.time, segment.end);
        points.push_back({segment.end, segment.last_work});
    }
    std::sort(points.begin(), points.end(), [](const ExecutedPoint& a, const ExecutedPoint& b) {
        return a.time != b.time ? a.time < b.time : a.work > b.work;
    });
    std::vector<ExecutedPiece> pieces;
    ExecutedPoint last{segment.begin, segment.first_work};
    const auto add = [&](const ExecutedPoint& to, bool is_open) {
        if (to.work <= last.work) return;
        const nanoseconds begin = last.time + idle_between(last, to, launches);
        if (begin < to.time) pieces.push_back({begin, to.time, to.work - last.work, is_open});
        last = to;
    };
    for (const ExecutedPoint& point : points) add(point, false);
    if (segment.how_ends == WorkSegment::End::kOpen) add({segment.end, segment.last_work}, true);
    return pieces;
}

}  // namespace urgengo::observe
