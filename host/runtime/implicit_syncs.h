// SPDX-License-Identifier: Apache-2.0
//
// Tasks whose threads are in a call that waits for all work of the context (implicit_syncs.cpp).
//
// @threads the one that has taken the task
#pragma once

#include "host/runtime/common.h"

namespace urgengo::runtime {

class ImplicitSyncs {
  public:
    /// @param common  outlives it
    explicit ImplicitSyncs(Common& common) : common_(common) {}

    /// @returns whether the task needs the whole GPU from now on: it has not before, and there is
    ///          something to wait for
    bool enter(TaskState& task);
    void leave(TaskState& task);
    /// Of a kernel in this process. Its end is due when the task is let go.
    void first_launch_begins(TaskState& task, identity::KnownKernel& kernel);

  private:
    Common& common_;
};

}  // namespace urgengo::runtime
