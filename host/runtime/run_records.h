// SPDX-License-Identifier: Apache-2.0
//
// What is written down of a run (abi/run_record.h), as the classes of this folder tell it. Off,
// each of these is one branch.
//
// @threads any; takes no lock
#pragma once

#include <atomic>
#include <string>

#include "host/base/clock.h"
#include "host/exec/driver_api.h"
#include "host/observe/miss_cause.h"
#include "host/observe/run_recorder.h"
#include "host/observe/status_page.h"
#include "host/progress/positions.h"
#include "host/runtime/stream_numbers.h"
#include "host/runtime/task.h"
#include "host/sched/governor.h"
#include "host/sched/guard_mode.h"

namespace urgengo::runtime {

class RunRecords {
  public:
    RunRecords() = default;  ///< off
    /// @param page  beside which the flight recorder lies; there is none if it is private. It
    ///              outlives this
    RunRecords(const observe::RecordOptions& options, const observe::ShareOptions& share,
               observe::StatusPage& page, const config::Config& config);

    /// Why there are none, though a trace was asked for; else empty.
    const std::string& note() const { return note_; }
    bool are_on() const { return recorder_.is_on(); }
    /// Of their file; empty if there are none.
    const std::string& path() const { return recorder_.path(); }

    void frame_begins(const ChainState& chain, nanoseconds arrival, nanoseconds now) {
        if (are_on()) add_frame_begin(chain, arrival, now);
    }
    void frame_ended(const ChainState& chain, nanoseconds arrival, const observe::Cause& cause,
                     bool exited, nanoseconds now) {
        if (are_on()) add_frame_end(chain, arrival, cause, exited, now);
    }
    void frame_dropped(const ChainState& chain, nanoseconds now);

    // By the thread that has taken the task:
    void task_begins(const TaskState& task, nanoseconds now) {
        if (are_on()) add_task(task, abi::RunKind::kTaskBegin, now);
    }
    void task_ended(const TaskState& task, nanoseconds now) {
        if (are_on()) add_task(task, abi::RunKind::kTaskEnd, now);
    }
    void segment_begins(const TaskState& task, nanoseconds now) {
        if (are_on()) add_segment(task, abi::RunKind::kSegmentBegin, false, now);
    }
    void segment_ended(const TaskState& task, bool idle, nanoseconds now) {
        if (are_on()) add_segment(task, abi::RunKind::kSegmentEnd, idle, now);
    }
    /// Of the launch at hand. The status page tells it, too.
    void priority(TaskState& task, int priority, Clock& clock) {
        if (task.facts.recorded_priority != priority) note_priority(task, priority, clock);
    }
    /// A launch, or copy, of the task waits for this from here on; told again if it is the same.
    void held(const TaskState& task, HoldPiece& piece, const sched::Wait& wait, nanoseconds now) {
        if (are_on()) add_held(task, piece, wait, now);
    }
    /// It waits no more.
    void hold_ended(const TaskState& task, HoldPiece& piece, nanoseconds now) {
        if (piece.begin.count() != 0) add_hold_end(task, piece, now);
    }

    // By its owner:
    void wait_begins(const TaskState& task, nanoseconds now) {
        if (are_on()) add_wait(task, abi::RunKind::kWaitBegin, now, now);
    }
    void wait_ended(const TaskState& task, nanoseconds begin, nanoseconds now) {
        if (are_on()) add_wait(task, abi::RunKind::kWaitEnd, begin, now);
    }

    /// A mark of the task was seen executed. @threads any
    void mark_seen(const TaskState& task, const progress::Positions::Seen& seen, nanoseconds laxity,
                   const model::GpuClock& gpu_clock, Clock& clock) {
        if (are_on()) add_mark(task, seen, laxity, gpu_clock, clock.now());
    }
    /// The first GPU that the program uses. Once.
    void describe_gpu(const exec::DriverApi& driver, CUdevice device);
    /// What UrgenGo does from here on.
    void mode(abi::StatusMode mode, nanoseconds now);
    /// The flight recorder keeps what was until now.
    void tripped(nanoseconds now);
    /// What one chain may be at most from here on; what the guard gives it.
    void chain_mode(const ChainState& chain, abi::StatusMode mode, nanoseconds now);
    void guard(const ChainState& chain, sched::GuardMode way, nanoseconds now);
    /// Another config was taken.
    void reloaded(nanoseconds now);
    /// No gate was closed from `begin` until now.
    struct Park {
        nanoseconds begin{0}, opening{0};
        std::uint32_t gated = 0, refused = 0;  ///< as abi::RunRecord says of them
    };
    void parked(const Park& park, nanoseconds now) {
        if (are_on()) add_park(park, now);
    }
    /// Gates were opened, in so many rounds that took so long together.
    struct Rounds {
        nanoseconds begin{0}, took{0};
        std::uint32_t opened = 0, rounds = 1;
        bool by_gpu = false;
    };
    void opened_gates(const Rounds& rounds, nanoseconds now) {
        if (are_on()) add_rounds(rounds, now);
    }

    void thread_ends() { recorder_.thread_ends(); }

  private:
    abi::RunRecord record_of(const TaskState& task, abi::RunKind kind, nanoseconds now) const;
    void add_frame_begin(const ChainState& chain, nanoseconds arrival, nanoseconds now);
    void add_frame_end(const ChainState& chain, nanoseconds arrival, const observe::Cause& cause,
                       bool exited, nanoseconds now);
    void note_cpu_use(nanoseconds now);
    void add_task(const TaskState& task, abi::RunKind kind, nanoseconds now);
    void add_segment(const TaskState& task, abi::RunKind kind, bool idle, nanoseconds now);
    void note_priority(TaskState& task, int priority, Clock& clock);
    void add_held(const TaskState& task, HoldPiece& piece, const sched::Wait& wait,
                  nanoseconds now);
    void add_hold_end(const TaskState& task, HoldPiece& piece, nanoseconds now);
    void add_hold(const TaskState& task, abi::RunKind kind, const HoldPiece& piece,
                  nanoseconds now);
    void add_wait(const TaskState& task, abi::RunKind kind, nanoseconds begin, nanoseconds now);
    void add_mark(const TaskState& task, const progress::Positions::Seen& seen, nanoseconds laxity,
                  const model::GpuClock& gpu_clock, nanoseconds now);
    void add_park(const Park& park, nanoseconds now);
    void add_rounds(const Rounds& rounds, nanoseconds now);
    void note_gpu_clock(const model::GpuClock& gpu_clock, nanoseconds now);

    observe::RunRecorder recorder_;
    observe::StatusPage* page_ = nullptr;
    std::vector<int> chain_of_;  ///< by task
    StreamNumbers streams_;
    std::atomic<std::int64_t> next_cpu_use_{0}, next_clock_{0};
    std::string note_;
};

}  // namespace urgengo::runtime
