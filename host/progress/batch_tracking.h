// SPDX-License-Identifier: Apache-2.0
//
// The paper's ways of knowing the executing kernel (`tracking:`, section 4.3.3 of the paper),
// beside progress marks and for comparison with them. What each learns is published in the task's
// slot and line as marks are, with sequence numbers of its own, so a reader of progress reads it
// unchanged:
//
//   async       nothing is asked. What has been launched counts as executed, all but a nanosecond:
//               the task stays on the GPU until the program's own wait, as if that were the mark of
//               the whole segment.
//   sync        after every launch the thread waits until it has executed.
//   batched     after every batch of launches, `eval_interval_us` of estimated GPU time.
//   overlapped  before the batch after next begins, until the last batch but one has executed: one
//               batch executes while the next is launched.
//
// A wait of ours asks for an event that was recorded behind the work, and does not call
// cuStreamSynchronize: that would never return where the work waits for something that this very
// thread does later (a value in memory, a host function). It asks without pause for as long as a
// spinning synchronisation of the driver's would pay, then with sleeps between; it ends by GPU
// progress, or after what an instance may be held, and then the instance is waited for no more.
// (While an event is pending, asking costs 0.09 us: H200, driver 580.159.04, 2026-11-21.) What the
// driver says to it, if the context is broken, it says to the program's next call, too.
//
// In mode `shadow` nothing is waited for: at a batch's end it is asked once whether it, and the one
// before it, have executed.
//
// Where no mark may be, the thread does not wait: captures, launches that depend on each other
// programmatically, one launch between two timing events. A run-ahead is not bounded: that is what
// the waits do.
//
// @threads one at a time is at a task; the tasks' slots and lines are read by any
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>

#include "host/base/clock.h"
#include "host/config/config.h"
#include "host/model/launch_log.h"
#include "urgengo/abi/device_mailbox.h"
#include "urgengo/abi/shared_page.h"

namespace urgengo::progress {

/// Of a task, what goes from one batch to the next.
struct TaskBatches {
    std::uint32_t published = 0;  ///< the batch that the task's line says has executed
    bool waited_in_vain = false;  ///< in this instance: no more waits of ours
    std::atomic<std::uint64_t> num_waits{0};
};

/// A task at its launches, as its thread has it. What is a reference is written, too.
struct BatchedTask {
    TaskBatches& batches;
    abi::TaskSlot& slot;
    ug_mark_line& line;
    model::LaunchLog& log;
    std::array<std::uint32_t, abi::kMarkRing>& position_at_mark;
    nanoseconds& marked;         ///< `launched` at the last batch's end
    const nanoseconds launched;  ///< estimated GPU time of all launches ever
    const std::uint32_t position;
};

/// How the end of a batch is seen: by what knows the driver (exec/batch_events.h).
class BatchEnds {
  public:
    enum class Seen { kYes, kNotYet, kRefused };

    /// Behind all that the task has launched. @returns whether it can be asked about now
    virtual bool record(std::uint32_t batch) = 0;
    virtual Seen ask(std::uint32_t batch) = 0;
    /// @returns whether the task's thread is to wait, or to wait any longer
    virtual bool are_wanted() = 0;

  protected:
    ~BatchEnds() = default;
};

class BatchTracking {
  public:
    enum class Outcome { kFine, kRefused, kWaitedInVain };

    /// @param clock  outlives it
    BatchTracking(config::Tracking tracking, nanoseconds batch, Clock& clock)
        : tracking_(tracking), batch_(batch), clock_(clock) {}

    /// The task has come to the GPU; its line is ours alone.
    void begin_segment(const BatchedTask& task) const;
    /// @returns whether end_batch() is due before another launch
    bool is_due(const BatchedTask& task) const;
    /// By the thread that has the task, in the context of its marks, outside of captures.
    /// @param bound  how long it may wait
    Outcome end_batch(const BatchedTask& task, BatchEnds& ends, nanoseconds bound) const;
    /// Of async: the launch counts as executed.
    void launched(const BatchedTask& task, nanoseconds estimate) const;
    /// @returns whether there are batches to ask about; but for the last `still_open`, which may go
    ///          on executing
    bool must_wait(const BatchedTask& task, std::uint32_t still_open) const;
    /// For those.
    Outcome wait(const BatchedTask& task, std::uint32_t still_open, BatchEnds& ends,
                 nanoseconds bound) const;
    /// The program has waited for all of it.
    void end_segment(const BatchedTask& task) const;

  private:
    Outcome wait_for(const BatchedTask& task, std::uint32_t batch, BatchEnds& ends,
                     nanoseconds bound) const;
    void issue(const BatchedTask& task, std::uint32_t batch) const;
    void publish(const BatchedTask& task, std::uint32_t batch) const;

    const config::Tracking tracking_;
    const nanoseconds batch_;  ///< estimated GPU time of one
    Clock& clock_;
};

}  // namespace urgengo::progress
