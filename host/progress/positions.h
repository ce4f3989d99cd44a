// SPDX-License-Identifier: Apache-2.0
//
// Where the GPU is in tasks' work: what every look at a task's progress tells of the GPU's clock,
// and with it, which kernel of a task is executing.
//
// @threads any; takes no lock, calls no driver
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <optional>

#include "host/base/clock.h"
#include "host/config/config.h"
#include "host/model/gpu_clock.h"
#include "host/model/launch_log.h"
#include "host/model/pace.h"
#include "host/model/position.h"
#include "host/model/task_plan.h"
#include "urgengo/abi/shared_page.h"

namespace urgengo::progress {

/// What a kernel counts for that the plan does not know.
inline constexpr nanoseconds kUnknownKernel{20'000};

/// Where the GPU is in a task's work.
struct TaskPosition {
    model::Position at;
    nanoseconds remaining{0};  ///< estimated GPU time of the task's newest instance and of what is
                               ///< left of those before it, launched or not
};

/// A task's work as any thread may read it.
struct FollowedTask {
    const abi::TaskSlot& slot;
    const std::atomic<const ug_mark_line*>& line;
    /// When the mark after the last one that was seen executed was last seen not to be.
    const std::atomic<std::int64_t>& pending_ns;
    /// Position in the plan of the first launch that is in the slot and not in the log.
    const std::atomic<std::uint32_t>& planned_from;
    const model::LaunchLog& log;
    model::Pace& pace;  ///< learns from marks
    const model::TaskPlan& plan;
};

class Positions {
  public:
    /// @param mark_visible  from the time that a mark writes to the host that sees it
    /// @param clock         outlives it
    Positions(config::Tracking tracking, nanoseconds mark_visible, Clock& clock)
        : follows_marks_(tracking == config::Tracking::kProgress),
          is_async_(tracking == config::Tracking::kAsync),
          mark_visible_(mark_visible),
          clock_(clock) {}

    /// A mark that was seen executed, and when it was, on the host's clock.
    struct Seen {
        model::ExecutedMark mark;
        std::optional<nanoseconds> time;
    };
    /// By the thread that has seen a mark executed first. It may be a later one by now.
    /// @param pending  when it was last seen not to be
    /// @param shared   others are on the GPU
    /// @returns nothing if the line changed under every attempt
    std::optional<Seen> saw_mark(const FollowedTask& task, const ug_mark_line& line,
                                 nanoseconds pending, bool shared);
    /// @returns nothing if it never launched anything that was scheduled, or what is known changed
    ///          under every look
    std::optional<TaskPosition> locate(const FollowedTask& task, bool shared, nanoseconds now);

    /// %globaltimer of the device whose work is scheduled, on the host's clock.
    const model::GpuClock& gpu_clock() const { return gpu_clock_; }

  private:
    /// The GPU's clock learns from marks this far apart: clocks drift by 60 ns in it at most, and
    /// it costs 0.1 us on the way of a launch.
    static constexpr nanoseconds kFeedClockEvery{100'000};
    /// Marks whose time is known this well tell of it whenever they come.
    static constexpr nanoseconds kTellsClock{10'000};

    /// Learns from an executed mark what it tells of the GPU's clock and of the task's pace.
    /// @returns when it ran, on the host's clock; nothing if that is not known
    std::optional<nanoseconds> learn_time(const FollowedTask& task, const ug_mark_line& line,
                                          const model::ExecutedMark& mark, nanoseconds pending,
                                          bool shared);
    model::SeenMark last_mark(const FollowedTask& task, bool shared, nanoseconds now);

    const bool follows_marks_, is_async_;
    const nanoseconds mark_visible_;
    Clock& clock_;
    model::GpuClock gpu_clock_;
    std::atomic<nanoseconds> fed_{nanoseconds{0}};
};

}  // namespace urgengo::progress
