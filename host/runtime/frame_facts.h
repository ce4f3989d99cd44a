// SPDX-License-Identifier: Apache-2.0
//
// What is noted of a task's runs, from which a late frame's cause is told (frame_causes.h): at the
// ends of segments and of waits, never by a launch that goes.
//
// @threads the thread that has the task (Taking::busy); any thread may read windows, holds
// and points
#pragma once

#include <pthread.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "host/base/clock.h"
#include "host/model/executed_points.h"
#include "host/observe/miss_cause.h"

namespace urgengo::runtime {

using std::chrono::nanoseconds;

/// Calls act(const Entry&) for the newest entries of a ring, the oldest of them first.
/// @param count  entries ever written; entry n lies at n % Size
/// @param most   entries to tell
template <typename Entry, std::size_t Size, typename Act>
void for_each_newest(const std::array<Entry, Size>& ring, const std::atomic<std::uint32_t>& count,
                     std::uint32_t most, Act&& act) {
    const std::uint32_t written = count.load(std::memory_order_acquire);
    most = std::min(most, static_cast<std::uint32_t>(Size));
    for (std::uint32_t n = written > most ? written - most : 0; n < written; ++n)
        act(ring[n % Size]);
}

/// The last GPU segments of a task, of which the newest may be under way.
class GpuWindows {
  public:
    static constexpr std::uint32_t kRing = 64;  ///< power of two
    static constexpr int kNone = 1 << 20;       ///< a priority that no launch has

    struct Segment {
        nanoseconds arrival{0}, deadline{0};                 ///< of its instance
        nanoseconds begin{0}, end{0};                        ///< 0: it is under way
        nanoseconds first_work{0}, last_work{0};             ///< on the axis of the LaunchLog
        bool is_executed = false;                            ///< all of it was, at its end
        nanoseconds alone{0};                                ///< that it takes, by the profile
        int first_priority = kNone, last_priority = -kNone;  ///< of its launches
    };

    /// @param launched  work before it
    void begin(nanoseconds arrival, nanoseconds deadline, nanoseconds launched, nanoseconds now);
    /// Launches of the one under way have this priority from here on.
    void launches_at(int priority);
    /// Of the one that was begun last, if it has not ended.
    /// @param launched  work with it
    void end(nanoseconds launched, bool is_executed, nanoseconds alone, nanoseconds now);
    /// Calls act(const Segment&) for each, the oldest first. One that is written meanwhile may be
    /// told wrong.
    /// @param most  of the newest
    template <typename Act>
    void for_each(Act&& act, std::uint32_t most = kRing) const {
        for_each_newest(ring_, count_, most, [&act](const Entry& entry) { act(read(entry)); });
    }

  private:
    struct Entry {
        std::atomic<std::int64_t> arrival{0}, deadline{0}, begin{0}, end{0};
        std::atomic<std::int64_t> first_work{0}, last_work{0}, alone{0};
        std::atomic<bool> is_executed{false};
        std::atomic<int> first_priority{kNone}, last_priority{-kNone};
    };
    static Segment read(const Entry& entry);

    std::array<Entry, kRing> ring_;
    std::atomic<std::uint32_t> count_{0};
};

/// When launches of a task were held last, and behind whom. Looks of one hold are one.
class HoldSpans {
  public:
    static constexpr std::uint32_t kRing = 128;  ///< power of two

    struct Hold {
        nanoseconds arrival{0};  ///< of its instance
        nanoseconds begin{0}, end{0};
        int behind = observe::kUnknownChain;  ///< chain
    };

    void add(const Hold& hold);
    /// Calls act(const Hold&) for each, as GpuWindows::for_each() does.
    template <typename Act>
    void for_each(Act&& act, std::uint32_t most = kRing) const {
        for_each_newest(ring_, count_, most, [&act](const Entry& entry) { act(read(entry)); });
    }

  private:
    struct Entry {
        std::atomic<std::int64_t> arrival{0}, begin{0}, end{0};
        std::atomic<int> behind{observe::kUnknownChain};
    };
    static Hold read(const Entry& entry);

    std::array<Entry, kRing> ring_;
    std::atomic<std::uint32_t> count_{0};
};

/// What a thread had had of the cores when its task's CPU segment began.
struct SegmentUse {
    nanoseconds time{0};  ///< 0: it was not asked
    ThreadUse use;
    pthread_t thread{};
};

/// Of the run that is under way.
struct RunFacts {
    nanoseconds began_late{0}, cpu_longer{0}, outside{0};
    nanoseconds gpu_longer{0};  ///< of a task without a plan, beyond what is usual
    nanoseconds gpu_beyond{0};  ///< of one with a plan, beyond that: its own, and others'
    std::uint32_t num_segments = 0;
    nanoseconds gpu_expected{0};  ///< what the GPU segments should have taken
    SegmentUse cpu_begin;
    nanoseconds cpu_took{0};         ///< the segment since then; 0: it has not ended
    nanoseconds gpu_took{0};         ///< of a task without a plan: all segments, without holds
    nanoseconds held_at_segment{0};  ///< GovernedRun::held at the begin of the one at hand
    bool was_off = false;
    std::optional<sched::GivenUp> given_up;
};

struct TaskFacts {
    RunFacts run;
    /// Chain on whose work the run's streams, or its thread, wait; -1: none. Its owner's.
    std::atomic<int> waits_for{-1};
    GpuWindows windows;
    HoldSpans holds;
    model::ExecutedPoints executed;      ///< written by who sees a mark first
    observe::Usual start, tail, gpu;     ///< of its runs
    nanoseconds ended_at{0};             ///< the last run
    std::vector<nanoseconds> cpu_times;  ///< of its segments, by the profile
};

}  // namespace urgengo::runtime
