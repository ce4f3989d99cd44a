// SPDX-License-Identifier: Apache-2.0
//
// Tasks on the GPU: from the first launch of a segment to the wait for it, with the marks between
// (gpu_segments.cpp), or the paper's batches (tracking.cpp); and the launches that went unasked,
// which are counted when a thread takes the task (catch_up.cpp).
//
// @threads the one that has taken the task
#pragma once

#include <atomic>

#include "host/progress/batch_tracking.h"
#include "host/runtime/common.h"

namespace urgengo::runtime {

class GpuSegments {
  public:
    /// @param common  outlives it
    explicit GpuSegments(Common& common);

    /// @returns whether its launches can be followed: else they go unscheduled
    bool enter(TaskState& task, nanoseconds now);
    /// @param idle  whether all that the task launched is known to have executed
    void leave(TaskState& task, bool idle);

    /// @returns whether a mark on the stream of the last launch vouches for all that was launched.
    ///          (On an earlier one there is none: that may be gone.)
    bool vouches(const TaskState& task) const {
        return common_.follows_marks() ? task.streams.graph.vouches() : !task.tracked.moved;
    }
    nanoseconds mark_every(const TaskState& task, nanoseconds now) const;
    bool mark_is_due(TaskState& task, nanoseconds now);
    /// Where one is due: emits it, or looks who else launches (Governor::looks_instead_of_mark).
    void mark_if_worth_it(TaskState& task, nanoseconds now);
    /// What is known of a mark's place.
    enum class Place { kBetween, kBeforeGate, kAtEnd };
    void emit_mark(TaskState& task, nanoseconds now, Place place = Place::kBetween);

    /// @returns whether what the task has launched since the last mark must have executed by its
    ///          estimates; then it is taken for executed
    bool must_have_executed(TaskState& task, nanoseconds now);
    /// Before a launch: whether the mark before the last one has executed tells.
    void see_whether_slow(TaskState& task, nanoseconds now);

    /// A mark behind a launch that is in a fork, for the task's own run-ahead
    /// (model/fork_progress.h).
    void mark_branch(TaskState& task, nanoseconds now);
    /// A launch was made, and is in the slot and the log: what no mark vouches for goes by time.
    void launched(TaskState& task, nanoseconds estimate, nanoseconds now);
    /// Counts the launches that its owner has made unasked.
    /// @param executed  all that the task has launched is known to be over
    void catch_up(TaskState& task, bool executed = false);

    /// Until no more batches than that are under way. @returns whether it did
    bool wait_for_batches(TaskState& task, std::uint32_t still_open);

  private:
    /// Points in a row that are believed without a mark (must_have_executed).
    static constexpr int kMostAssumed = 15;
    /// Unknown kernels take this part of what they count for, or more: launches that come faster
    /// are not believed to be slow.
    static constexpr int kLeastOfUnknown = 4;

    static void all_executed(TaskState& task);
    bool launches_slowly(const TaskState& task, nanoseconds now) const;
    static bool is_looked_for(const TaskState& task);
    /// As of the last look.
    static bool all_marks_seen(const TaskState& task) {
        return task.slot->marks_done.load(std::memory_order_relaxed) ==
               task.slot->marks_issued.load(std::memory_order_relaxed);
    }
    void refuse_marks(TaskState& task);

    // catch_up.cpp
    static void catch_up_observed(TaskState& task, std::uint32_t launches);
    static void log_as_planned(TaskState& task, std::size_t at, std::uint32_t launches,
                               nanoseconds now);
    static void log_executed(TaskState& task, std::size_t at, std::uint32_t launches,
                             nanoseconds total, nanoseconds now);

    // tracking.cpp
    /// Of a task on the GPU.
    static progress::BatchedTask batched(TaskState& task);
    void end_batch(TaskState& task);
    void heed(TaskState& task, progress::BatchTracking::Outcome outcome);

    Common& common_;
    std::atomic<CUdevice> device_{-1};  ///< the one whose work is scheduled: the first seen
    const progress::BatchTracking batches_;
};

}  // namespace urgengo::runtime
