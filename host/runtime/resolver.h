// SPDX-License-Identifier: Apache-2.0
//
// Whose launch is it, and of which instance (resolver.cpp).
//
// @threads any, each about itself
#pragma once

#include <string_view>

#include "host/identity/task_names.h"
#include "host/runtime/copies.h"
#include "host/runtime/frames.h"
#include "host/runtime/work_on_streams.h"

namespace urgengo::runtime {

class Resolver final : public CopyingThreads {
  public:
    /// @param all of them  outlive it
    Resolver(Common& common, Runs& runs, Frames& frames, WorkOnStreams& streams);

    /// @returns the task that the launch belongs to, taken by this thread; null: of none
    TaskState* resolve(ThreadState& thread, const Launch& launch, const model::KernelKey& key,
                       const identity::KnownKernel* kernel, nanoseconds now);
    /// Of a launch that was not resolved. @returns whether it is of a chain even so
    bool may_be_chains(const ThreadState& thread, const Launch& launch) const;

    /// The thread waits or records events; perhaps it never launches.
    void let_pass_if_bystander(ThreadState& thread);

    /// The thread has entered an NVTX range of this name, or left one (observe/nvtx_ranges.h has
    /// them all). A range that a task's `nvtx:` names is an instance of it.
    void range_pushed(ThreadState& thread, std::string_view name);
    void range_popped(ThreadState& thread);

    TaskState* copying_task(ThreadState& thread) override;
    bool take_own(ThreadState& thread, TaskState& task) override;
    void release(ThreadState& thread) override { runs_.release(thread); }

    identity::TaskNames& names() { return names_; }

  private:
    TaskState* follow(ThreadState& thread, TaskState& task, const Launch& launch,
                      const model::KernelKey& key, nanoseconds now);
    /// @param expected  the task in progress expects this launch next
    TaskState* choose(ThreadState& thread, const model::KernelKey& key,
                      const identity::KnownKernel* kernel, bool expected) const;
    static model::Fit begins(const TaskState& task, const model::KernelKey& key,
                             const identity::KnownKernel* kernel);
    TaskState* join(ThreadState& thread, TaskState* task, const Launch& launch,
                    const model::KernelKey& key);
    void read_thread_name(ThreadState& thread);
    void follow_ranges(ThreadState& thread);
    void let_pass(ThreadState& thread, CUstream stream) const;

    Common& common_;
    Runs& runs_;
    Frames& frames_;
    WorkOnStreams& streams_;
    identity::TaskNames names_;
};

}  // namespace urgengo::runtime
