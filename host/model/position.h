// SPDX-License-Identifier: Apache-2.0
//
// Which kernel of a task is the GPU at, between two marks? The paper's I^gpu of Eq. 2, which it
// knows only at batch synchronisations.
//
//  1 What is certain. Mark s is the last one executed, at host time t_s: everything before it is
//    done, nothing behind the next mark has begun. Without a next mark, nothing behind the newest
//    launch has. So the GPU is at a launch in [n0, n1), n0 launches before mark s and n1 before the
//    next one.
//  2 What is likely. From t_s on the launches behind the mark run one after the other, none before
//    it was launched:
//
//        begin(n) = max(end(n - 1), launched(n) + kLaunchLatency),   end(n0 - 1) = t_s
//        end(n)   = begin(n) + pace * estimate(n)
//
//    and the GPU is at the launch with begin(n) <= now - stalled < end(n). If all of them had been
//    launched when the mark ran, the usual case, there are no gaps, and n is found by bisection of
//    the launches' sums instead.
//  3 What it must not do. If time says more than 1 allows, the answer stays at the bound: the last
//    launch before the next mark, with nothing known to remain of it; behind the last mark, all
//    done. A task that others keep from the GPU runs at no more than what marks show: `stalled` is
//    time in which it certainly did not run, `pace` how much slower than estimated it has been
//    going lately (pace.h). Of a kernel that shares the GPU and has a launch or a mark behind it,
//    something remains when it should be over: by then it is more likely one that takes longer.
//    What is overdue by SlotView's rule waits for something else.
//
// The error is at most the span between the marks, whatever the estimates are.
#pragma once

#include <optional>

#include "host/model/launch_log.h"
#include "urgengo/abi/device_mailbox.h"

namespace urgengo::model {

/// From the begin of a launch call until its kernel runs on an idle GPU: half of the round trip of
/// 6.3 us. @source measured, H200, 2026-11-21
inline constexpr nanoseconds kLaunchLatency{3'000};
/// Measured paces beyond these say nothing about what comes next.
inline constexpr double kMinPace = 0.25;
inline constexpr double kMaxPace = 8;

/// A mark as the GPU wrote it.
struct ExecutedMark {
    std::uint32_t sequence = 0;
    std::uint32_t position = 0;
    std::uint16_t instance = 0;
    std::uint64_t stamp = 0;  ///< low 48 bits of %globaltimer
};

/// @param newest  a sequence number less than 2^15 from the one in the line, such as the last one
///                issued
/// @returns nothing if the line changed under every attempt
/// @threads any
std::optional<ExecutedMark> read_mark(const ug_mark_line& line, std::uint32_t newest);

/// The last executed mark as far as the host knows.
struct SeenMark {
    std::uint32_t sequence = 0;
    nanoseconds time{0};  ///< when it ran, on the host's clock (gpu_clock.h)
};

struct Tempo {
    double pace = 1;         ///< GPU time per estimated GPU time
    nanoseconds stalled{0};  ///< since the mark, in which the task's kernels did not run
    bool shared = false;     ///< others are on the GPU: work may take longer still
};

struct Position {
    bool busy = false;           ///< executing `launch`; else that one is the next
    bool overdue = false;        ///< the next mark should have run long ago
    std::uint32_t launch = 0;    ///< number in the log
    std::uint32_t position = 0;  ///< of that launch in its instance
    std::uint16_t instance = 0;  ///< whose it is; not the newest one while instances overlap
    nanoseconds executed{0};     ///< work that is done
    nanoseconds unexecuted{0};   ///< work launched and not done
    nanoseconds uncertain{0};  ///< work that the marks leave open: executed is off by less than it
};

/// @param unlogged  work launched behind the newest entry of the log, and not in it yet
///                  (runtime/planned_launches.cpp)
/// @returns where the GPU is; nothing if the log moved on too far while it was read. Once it is at
///          work that is not logged, `launch` stays behind the newest entry, and `executed` moves
///          on
/// @threads any; takes no lock
std::optional<Position> locate(const LaunchLog& log, const SeenMark& seen, const Tempo& tempo,
                               nanoseconds now, nanoseconds unlogged = nanoseconds{0});

}  // namespace urgengo::model
