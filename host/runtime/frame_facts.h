// SPDX-License-Identifier: Apache-2.0
//
// What is noted of a task's runs, from which a late frame's cause is told (frame_causes.h): at the
// ends of segments and of waits, never by a launch that goes.
//
// @threads the thread that has the task (Taking::busy); windows may be read by any thread
#pragma once

#include <pthread.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <optional>
#include <vector>

#include "host/base/clock.h"
#include "host/observe/miss_cause.h"

namespace urgengo::runtime {

using std::chrono::nanoseconds;

/// The last GPU segments of a task, of which the newest may be under way.
class GpuWindows {
  public:
    static constexpr std::uint32_t kRing = 16;  ///< power of two
    static constexpr int kNone = 1 << 20;       ///< a priority that no launch has

    struct Segment {
        nanoseconds arrival{0}, deadline{0};                 ///< of its instance
        nanoseconds begin{0}, end{0};                        ///< 0: it is under way
        nanoseconds gpu{0};                                  ///< by the plan
        int first_priority = kNone, last_priority = -kNone;  ///< of its launches
    };

    void begin(nanoseconds arrival, nanoseconds deadline, nanoseconds now);
    /// Launches of the one under way have this priority from here on.
    void launches_at(int priority);
    /// Of the one that was begun last, if it has not ended.
    void end(nanoseconds now, nanoseconds gpu);
    /// Calls act(const Segment&) for each, the oldest first. One that is written meanwhile may be
    /// told wrong.
    template <typename Act>
    void for_each(Act&& act) const {
        const std::uint32_t count = count_.load(std::memory_order_acquire);
        for (std::uint32_t n = count > kRing ? count - kRing : 0; n < count; ++n)
            act(read(ring_[n % kRing]));
    }

  private:
    struct Entry {
        std::atomic<std::int64_t> arrival{0}, deadline{0}, begin{0}, end{0}, gpu{0};
        std::atomic<int> first_priority{kNone}, last_priority{-kNone};
    };
    static Segment read(const Entry& entry);

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
    observe::TimeBehind held;
    nanoseconds began_late{0}, cpu_longer{0}, outside{0}, gpu_longer{0};
    nanoseconds gpu_by_factor{0};  ///< of gpu_longer: observe::FrameFacts says of it
    nanoseconds gpu_expected{0};   ///< what the GPU segments should have taken
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
    observe::Usual start, tail, gpu;     ///< of its runs
    nanoseconds ended_at{0};             ///< the last run
    std::vector<nanoseconds> cpu_times;  ///< of its segments, by the profile
    nanoseconds longest_kernel{0};       ///< of its plan
};

}  // namespace urgengo::runtime
