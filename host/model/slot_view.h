// SPDX-License-Identifier: Apache-2.0
//
// What a decision may know of one task: a consistent reading of its slot in the active kernel
// buffer, together with how far the GPU is.
#pragma once

#include <chrono>
#include <cstdint>

#include "host/model/launch_contention.h"
#include "host/model/urgency.h"
#include "urgengo/abi/device_mailbox.h"
#include "urgengo/abi/shared_page.h"

namespace urgengo::model {

/// How long a task may do nothing between two launches and still count as being on the GPU.
/// @source host/README.md, What a launch is held for
inline constexpr std::int64_t kLaunchGrace_ns = 200'000;
inline constexpr nanoseconds kLaunchGrace{kLaunchGrace_ns};
/// The same of one whose launching others slow down, to them: it may wait for what they share.
inline constexpr std::int64_t kLaunchingGrace_ns = 1'000'000;
/// Work that is late by this, after twice its estimate, is overdue.
inline constexpr std::int64_t kOverdue_ns = 1'000'000;
inline constexpr nanoseconds kOverdue{kOverdue_ns};
/// A held thread looks again at least every 10 ms; one that has not for this long is gone.
inline constexpr std::int64_t kHeldHeartbeat_ns = 50'000'000;

/// What a task is about.
struct SlotState {
    bool active = false;     ///< works on an instance
    bool ranked = false;     ///< is on the GPU: has work there, or is about to launch
    bool overdue = false;    ///< its work should be done by now: it waits for something else
    bool blocking = false;   ///< others may have to wait for it: ranked, and not overdue, or only
                             ///< as less urgent work was before it
    bool started = false;    ///< has launched in the GPU segment at hand
    bool needs_all = false;  ///< is in a call that waits for all GPU work, of all tasks
    bool demoted = false;    ///< is late, and its chain gives way to all then
    bool is_lent = false;    ///< its deadline is that of a task that waits for its work
    bool starved = false;    ///< has given way for so long that it comes before all for a while
};

/// What an instance needs, alone.
struct TimeLeft {
    nanoseconds gpu{0};
    nanoseconds cpu{0};
    nanoseconds idle{0};  ///< that the GPU will wait for launches
};

/// A task's run-ahead: what was launched and has not executed.
struct AheadView {
    nanoseconds launched{0};  ///< GPU time of it
    nanoseconds waited{0};    ///< for what is next of that
    nanoseconds patience{0};  ///< after which that is overdue
    bool progressed = false;  ///< this look was the first that saw the last executed mark
    bool pending = false;     ///< there is a mark after that, which was not executed yet
};

/// How a task's thread launches.
struct LaunchingView {
    bool is_next = false;  ///< it is about to make the next launch, or waits only for its turn
    bool pauses = false;   ///< it has more to launch, and has not for a while
    Launching slowed = Launching::kUnknown;  ///< whether others' launching slows its own
    double share = 0;  ///< what it takes of that: 1 of them launches at a time; 0: nothing
    int speed_pm = 0;  ///< in thousandths of that alone; 0: as alone
};

/// What does not change with the instance.
struct ChainView {
    nanoseconds relative_deadline{0};  ///< D
    nanoseconds gpu{0}, cpu{0};
    int criticality = 1;
    int static_rank = 0;  ///< 0 for the chain with the tightest deadline
};

struct SlotView {
    /// `task` of an instance that should arrive soon and has no slot yet.
    static constexpr int kExpected = -1;

    int task = 0;       ///< index of the slot
    int of_chain = -1;  ///< of an instance without a slot: index of its chain
    SlotState state;
    nanoseconds deadline{0};  ///< t_arr + D
    nanoseconds period{0};
    TimeLeft remaining;  ///< of the instance: this task's and the chain's later ones'. Its time
                         ///< alone is gpu + idle, besides the CPU segments
    TimeLeft later;  ///< of that, the chain's later tasks'; of cpu, all after the segment at hand
    nanoseconds release{0};  ///< when it has GPU work again: now, unless it is on the CPU
    nanoseconds laxity{0};   ///< Eq. 2, now
    /// By so much longer what remains takes than alone, as a bystander is busy; 0: not known.
    nanoseconds longer_beside{0};
    double utilization = 0;  ///< of the launch at hand, 0..1
    nanoseconds next{0};     ///< GPU time of the launch at hand; of the task that asks
    AheadView ahead;
    bool is_supported = true;  ///< its record supports the estimates: it may be given up
    LaunchingView launching;
    ChainView chain;
    double mean_utilization = 0;  ///< of the task's kernels, by their time, 0..1

    constexpr nanoseconds arrival() const { return deadline - chain.relative_deadline; }
    /// Of this task, from now on: GPU work, and with it what the GPU will wait for launches.
    constexpr nanoseconds own_gpu() const { return remaining.gpu - later.gpu; }
    constexpr nanoseconds own_alone() const { return own_gpu() + remaining.idle - later.idle; }
    /// @returns the part of the time in which the GPU works for it, 0..1: below 1 it launches more
    ///          slowly than the GPU executes. Less than alone where others slow its launching down.
    constexpr double gpu_share() const {
        const nanoseconds alone = own_alone();
        const double planned = alone.count() <= 0 ? 1
                                                  : static_cast<double>(own_gpu().count()) /
                                                        static_cast<double>(alone.count());
        return launching.speed_pm == 0 ? planned : planned * (launching.speed_pm * 1e-3);
    }
};

/// @returns the sequence number of the last mark that the GPU executed. It may be ahead of
/// `marks_issued`, which the launching thread stores after the launch. `fallback` if the line
/// changed under every attempt.
/// @threads any
std::uint32_t read_marks_done(const ug_mark_line& line, std::uint32_t marks_issued,
                              std::uint32_t fallback);

/// @returns GPU time of launches whose estimates by the plan add up to `estimated`
nanoseconds corrected(const abi::TaskSlot& slot, nanoseconds estimated);

/// @param left  what it has not launched yet
/// @param last  when it last launched, or asked to
/// @returns whether a task's thread is about to make its next launch: not held, and not busy with
///          anything else for more than a moment
constexpr bool is_launching(abi::TaskState state, nanoseconds left, nanoseconds last,
                            nanoseconds now) {
    return state == abi::TaskState::kGpu && left.count() > 0 &&
           (now - last).count() < kLaunchingGrace_ns;
}
/// The same of a slot, where nothing else of it is asked.
/// @threads any
bool is_launching(const abi::TaskSlot& slot, nanoseconds now);

/// Reads a slot. Advances its marks_done and progress_ns to what `line` shows.
/// @param line  the task's mailbox line, or null before any mark could be issued
/// @returns the view; neither active nor ranked if the slot is idle or changed while being read
/// @threads any; takes no lock
SlotView read_slot(abi::TaskSlot& slot, const ug_mark_line* line, int task, nanoseconds now);

}  // namespace urgengo::model
