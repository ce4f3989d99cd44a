// SPDX-License-Identifier: Apache-2.0
//
// A launch that is asked about: from the question to the mark behind it (launch_path.cpp).
//
// @threads any, each about itself; takes no lock and allocates nothing, but where the priority goes
//          by a stream (config: priority_via), and for graphs
#pragma once

#include <optional>

#include "host/runtime/gates.h"
#include "host/runtime/planned_launches.h"
#include "host/runtime/random_holds.h"
#include "host/runtime/resolver.h"

namespace urgengo::runtime {

class LaunchPath {
  public:
    /// All outlive it.
    struct Around {
        GpuSegments& segments;
        ImplicitSyncs& syncs;
        Runs& runs;
        WorkOnStreams& streams;
        Resolver& resolver;
        PlannedLaunches& planned;
        Gates& gates;
    };
    /// @param test_holds  not 0: seed of holds at random, for tests
    LaunchPath(Common& common, const Around& around, std::uint64_t test_holds)
        : common_(common), around_(around), random_holds_(test_holds) {}

    /// May wait: holds the launch. Call after() with the answer if it has a task or is traced.
    Grant before(ThreadState& thread, const Launch& launch);
    void after(ThreadState& thread, const Launch& launch, const Grant& grant, bool succeeded);

    config::PriorityVia priority_via() const { return common_.scheduler.priority.via; }
    /// Of a graph that is to run each kernel at the priority that it was captured at.
    /// @returns the priority of all of them, where the graph is to take its stream's instead
    std::optional<int> replaceable_priority(CUgraph graph) const;
    /// Before a launch on a stream of ours instead of the program's (exec/priority_pool.h).
    /// @returns null: it goes as it came; else streams().pool().join() is due after it
    const exec::PriorityPool::Lane* enter_pool(const Launch& launch, const Grant& grant);

  private:
    Grant decide(ThreadState& thread, const Launch& launch);
    static model::KernelEstimate estimate(TaskState& task, const Launch& launch,
                                          const model::KernelKey& key, double graph_utilization);
    void find_room(const Launch& launch, identity::KnownKernel& kernel, nanoseconds until);
    sched::Request request_for(const TaskState& task) const;
    sched::Answer ask(TaskState& task, nanoseconds now);
    sched::Decision hold_until_admitted(TaskState& task, bool may_stand_behind_gate,
                                        nanoseconds now);
    void count_wait(TaskState& task, const sched::Wait& wait, nanoseconds time);
    void hold_at_random(TaskState& task);
    void would_hold(TaskState& task, const sched::Answer& answer, nanoseconds now);
    int priority_for(TaskState& task, const Launch& launch, const sched::Decision& decision,
                     nanoseconds now);

    Common& common_;
    const Around around_;
    RandomHolds random_holds_;
};

}  // namespace urgengo::runtime
