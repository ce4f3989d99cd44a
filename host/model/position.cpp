// SPDX-License-Identifier: Apache-2.0
#include "host/model/position.h"

#include <algorithm>
#include <cmath>

#include "host/model/slot_view.h"

namespace urgengo::model {
namespace {

/// Launches to walk along; further ones are taken to follow without gaps.
constexpr std::uint32_t kMaxWalk = 64;

bool is_later(std::uint32_t a, std::uint32_t b) {
    return static_cast<std::int32_t>(a - b) > 0;
}

nanoseconds times(nanoseconds t, double factor) {
    return nanoseconds(static_cast<std::int64_t>(static_cast<double>(t.count()) * factor));
}

struct Range {
    std::uint32_t first = 0, end = 0;  ///< launches that the GPU may be at
    nanoseconds time{0};               ///< it was at the first one's begin
    bool marked = false;               ///< a mark that has not run comes behind them
    std::uint32_t mark = 0;            ///< the oldest whose entry counts
};

Range range_of(const LaunchLog& log, const SeenMark& seen, nanoseconds now) {
    Range r{0, 0, seen.time, false, seen.sequence};
    // In this order: no mark has more launches before it than are read afterwards.
    std::uint32_t issued = log.last_mark();
    const std::uint32_t count = log.count();
    if (is_later(r.mark, issued)) issued = r.mark;
    // The oldest mark that is still known, and no idea when it ran.
    if (issued - r.mark >= abi::kMarkRing - 1) {
        r.mark = issued - abi::kMarkRing + 2;
        r.time = now;
    }
    r.first = log.launches_before_mark(r.mark);
    r.end = count;
    for (std::uint32_t next = r.mark + 1; !is_later(next, issued); ++next) {
        const std::uint32_t launches = log.launches_before_mark(next);
        if (launches == r.first) continue;  // two marks with nothing between them
        r.end = launches;
        r.marked = true;
        break;
    }
    if (count - r.first > LaunchLog::kReadable) {
        r.first = count - LaunchLog::kReadable;
        r.time = now;
        if (is_later(r.first, r.end)) r.end = r.first;
    }
    return r;
}

/// From here on a kernel that shares the GPU is thought to slow down; and what shares it runs at no
/// less than this pace: what did was kept from it, which says nothing of the next kernel. (Ten
/// chains on the H200, marks at their true times: remaining work is off by 10 % less at 99 %.)
constexpr double kMostlyDone = 0.7;
constexpr double kSlowestShared = 1.5;

/// @param part  of the kernel that should be done, more than 1 when it is late
/// @returns what to expect of one that is not over yet
double part_done(double part) {
    constexpr double kRest = 1 - kMostlyDone;
    if (part < kMostlyDone) return part;
    return kMostlyDone + kRest * (1 - std::exp(-(part - kMostlyDone) / kRest));
}

// How far it is at `now`, were it alone: section 2 of the header.
struct Reached {
    std::uint32_t launch = 0;
    nanoseconds executed{0};
    bool busy = false;
};

Reached reached(const LaunchLog& log, const Range& r, double pace, nanoseconds now) {
    std::uint32_t n = r.first;
    nanoseconds time = r.time;
    nanoseconds work = log.end(n - 1);
    const bool may_have_gaps = log.time(r.end - 1) + kLaunchLatency > r.time;
    const std::uint32_t walk_end = may_have_gaps ? n + std::min(r.end - n, kMaxWalk) : n;
    for (; n != walk_end; ++n) {
        time = std::max(time, log.time(n) + kLaunchLatency);
        if (time > now) return {n, work, false};
        const nanoseconds end = log.end(n);
        const nanoseconds duration = times(end - work, pace);
        if (time + duration > now)
            return {n, std::min(work + times(now - time, 1 / pace), end), true};
        time += duration;
        work = end;
    }
    work += times(std::max(now - time, nanoseconds{0}), 1 / pace);
    std::uint32_t left = r.end - n;
    while (left > 0) {
        const std::uint32_t half = left / 2;
        if (log.end(n + half) > work) {
            left = half;
        } else {
            n += half + 1;
            left -= half + 1;
        }
    }
    return {n, work, true};
}

}  // namespace

std::optional<ExecutedMark> read_mark(const ug_mark_line& line, std::uint32_t newest) {
    for (int attempt = 0; attempt < 4; ++attempt) {
        const std::uint64_t word0 = __atomic_load_n(&line.word[0], __ATOMIC_ACQUIRE);
        const std::uint64_t word1 = __atomic_load_n(&line.word[1], __ATOMIC_ACQUIRE);
        const auto tag = static_cast<std::uint16_t>(word0);
        if (tag != static_cast<std::uint16_t>(word1)) continue;
        // Never 2^15 marks are in flight, so the tag names one sequence number near the newest one.
        const auto ahead = static_cast<std::int16_t>(tag - static_cast<std::uint16_t>(newest));
        return ExecutedMark{newest + static_cast<std::uint32_t>(ahead),
                            static_cast<std::uint32_t>(word0 >> 32),
                            static_cast<std::uint16_t>(word0 >> 16), word1 >> 16};
    }
    return std::nullopt;
}

std::optional<Position> locate(const LaunchLog& log, const SeenMark& seen, const Tempo& tempo,
                               nanoseconds now, nanoseconds unlogged) {
    Range r = range_of(log, seen, now);
    Position p;
    const nanoseconds done = log.end(r.first - 1);
    const double pace = std::clamp(tempo.pace, kMinPace, kMaxPace);
    // Behind a mark that has not run, nothing is: not what is unlogged, either.
    const nanoseconds behind = r.marked ? nanoseconds{0} : unlogged;
    const nanoseconds bound = log.end(r.end - 1) + behind;
    // It came after the newest launch.
    if (r.first == r.end) r.time = std::max(r.time, log.time(r.end - 1) + kLaunchLatency);
    p.launch = r.first;
    p.executed = done;
    if (bound != done || r.first != r.end) {
        const Reached at = reached(log, r, pace, now - tempo.stalled);
        p.busy = at.busy;
        p.launch = at.launch;
        p.executed = std::min(at.executed, bound);
        if (p.launch == r.end) {
            p.busy = r.marked || p.executed < bound;
            if (r.marked) --p.launch;
        }
        if (tempo.shared && p.busy && is_later(r.end, p.launch)) {
            const nanoseconds begin = log.end(p.launch - 1);
            const nanoseconds whole = log.end(p.launch) - begin;
            const double part = static_cast<double>((at.executed - begin).count()) * pace /
                                std::min(pace, kSlowestShared) /
                                std::max(static_cast<double>(whole.count()), 1.0);
            p.executed = std::min(begin + times(whole, part_done(part)), bound);
        }
        const nanoseconds begin = std::max(r.time, log.time(r.first));
        p.overdue = now - tempo.stalled - begin > 2 * (bound - done) + kOverdue;
        p.uncertain = bound - done;
    }
    const std::uint32_t count = log.count();
    p.unexecuted = log.end(count - 1) + unlogged - p.executed;
    // Behind the newest launch nothing is known: it is the one after it.
    const bool is_next = p.launch == count;
    const LoggedLaunch launch = log.at(is_next ? p.launch - 1 : p.launch);
    p.instance = launch.instance;
    p.position = launch.position + (is_next ? 1 : 0);
    if (!log.still_holds(r.first - 1, r.mark)) return std::nullopt;
    return p;
}

}  // namespace urgengo::model
