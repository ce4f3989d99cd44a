// SPDX-License-Identifier: Apache-2.0
//
// Which launches need no asking, and may be made at once (planned_launches.cpp; as_planned.h: as
// their thread makes them).
//
// @threads any, each about itself
#pragma once

#include "host/runtime/calls.h"
#include "host/runtime/runs.h"

namespace urgengo::runtime {

class PlannedLaunches {
  public:
    /// @param all of them  outlive it
    PlannedLaunches(Common& common, GpuSegments& segments, Runs& runs)
        : common_(common), segments_(segments), runs_(runs) {}

    /// Whether this launch needs no asking. If so, the caller makes it at once, as
    /// thread.line.as_planned says, and tells went_as_planned() if it succeeded (as_planned.h).
    bool goes(ThreadState& thread, const Launch& launch);
    /// Of a launch that goes as planned among others (as_planned.is_watched): whether they reckon
    /// with its task still, and then do from now on. Throws nothing.
    bool is_reckoned_with(const ThreadState& thread);

    /// After a launch that was asked about, by the thread that has taken the task: which ones of
    /// those to come need no asking.
    void allow(ThreadState& thread, const Launch& launch, const Grant& grant);
    /// The same after a launch of a run that is not scheduled: all up to the segment's end.
    void allow_observed(ThreadState& thread, const Launch& launch, const Grant& grant);

  private:
    bool may_go_unasked(const ThreadState& thread, const Launch& launch, const Grant& grant) const;
    bool are_handles_good(const ThreadState& thread) const;
    void plan_observed(ThreadState& thread, TaskState& task) const;
    void go_on_observed(ThreadState& thread);
    static void forget_old_functions(ThreadState& thread, TaskState& task);
    static bool is_at_work(const ThreadState& thread, const TaskState& task);
    static void learn_function(ThreadState& thread, const Launch& launch);
    void plan_ahead(ThreadState& thread, TaskState& task, nanoseconds now);
    static void keep_small(ThreadLine::AsPlanned& planned, double utilization);
    std::size_t before_held(const TaskState& task, std::size_t position, std::size_t end) const;
    void go_on(ThreadState& thread);

    Common& common_;
    GpuSegments& segments_;
    Runs& runs_;
};

}  // namespace urgengo::runtime
