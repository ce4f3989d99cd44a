// SPDX-License-Identifier: Apache-2.0
//
// Gates: a launch that would have to wait is made at once, behind a wait of its stream (a gate),
// and so are those after it, in groups. Who opens the gates is the dispatcher: a thread of ours, or
// the GPU (config: dispatch). So the launching thread does not sleep, and loses its turn on a busy
// core to none; and what it launched begins without it.
//
//   1 The first launch that would have to wait closes a gate. What its task launches from then on
//     needs no asking, and goes behind that gate or further ones, until all of them are open
//     (sched/gate_groups.h).
//   2 A group has launches that take alike of the GPU, for `dispatch.group_us` at most; a longer
//     kernel is a group of its own. Before each gate there is a mark: it tells of the group before,
//     and of the gate. A group's launches have the priority of their task's rank as it is launched.
//   3 At most `dispatch.most_gates` of a task are closed, behind them at most 200 launches, and at
//     most connections - 2 tasks have closed gates: a closed gate keeps its hardware channel.
//     Beyond that launches wait in their threads.
//   4 No gate is closed in a stream that others wait for implicitly (the legacy stream, one that
//     synchronises with it), of a task on several streams at once, before a kernel that must be
//     loaded, nor while a call is under way before which all gates were opened (park()).
//   5 A gate opens by itself after what the instance may be held (scheduler.hold): the thread of
//     ours sees to that.
//
// @threads the one that has taken the task; takes no lock
#pragma once

#include "host/config/limits.h"
#include "host/runtime/common.h"
#include "host/runtime/gpu_segments.h"

namespace urgengo::runtime {

class Gates {
  public:
    /// Both outlive it.
    Gates(Common& common, GpuSegments& segments) : common_(common), segments_(segments) {}

    bool are_on() const { return common_.gate_keeper.are_on(); }
    /// A launch that is to wait. @returns whether it goes, behind a gate that was closed for it
    bool close(TaskState& task, const sched::Answer& answer, nanoseconds now);
    /// A launch of a task with closed gates. @returns whether it goes, behind the last of them
    bool takes(TaskState& task, nanoseconds now);

    static bool are_closed(const TaskState& task) {
        const abi::TaskSlot& slot = *task.slot;
        return slot.gates_closed.load(std::memory_order_relaxed) !=
               slot.gates_opened.load(std::memory_order_acquire);
    }

  private:
    static_assert(config::kMostGates.max < abi::kGateRing);

    bool are_wanted(TaskState& task);
    bool may_close(TaskState& task, const sched::Wait& wait);
    bool is_beside(const TaskState& task) const {
        return task.tracked.stream != task.gates.stream || !segments_.vouches(task);
    }
    bool put(TaskState& task, nanoseconds now);
    void rank_anew(TaskState& task, nanoseconds now);
    void wait_until_open(TaskState& task, std::uint32_t gate);

    Common& common_;
    GpuSegments& segments_;
};

}  // namespace urgengo::runtime
