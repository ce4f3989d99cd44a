// SPDX-License-Identifier: Apache-2.0
//
// Tasks as a decision sees them, made up.
#pragma once

#include <algorithm>
#include <vector>

#include "host/sched/admission.h"

namespace urgengo::testing {

inline const config::Scheduler kUrgency = [] {
    config::Scheduler s;
    s.policy = config::Policy::kUrgency;
    return s;
}();

/// A task on the GPU, which others may have to wait for.
inline model::SlotView task(int index, std::chrono::nanoseconds laxity, double utilization,
                            std::chrono::nanoseconds deadline = std::chrono::milliseconds(100)) {
    model::SlotView v;
    v.task = index;
    v.state.active = v.state.ranked = v.state.blocking = true;
    v.laxity = laxity;
    v.deadline = deadline;
    v.utilization = utilization;
    return v;
}

/// A task that the GPU works for in a quarter of its time alone.
inline model::SlotView launch_bound(int index, std::chrono::nanoseconds laxity,
                                    double utilization) {
    model::SlotView v = task(index, laxity, utilization);
    v.remaining.gpu = std::chrono::milliseconds(5);
    v.remaining.idle = std::chrono::milliseconds(15);
    return v;
}

/// One that is small, and slowed by others that launch.
inline model::SlotView slowed(int index, std::chrono::nanoseconds laxity) {
    model::SlotView v = launch_bound(index, laxity, 0.1);
    v.launching.slowed = model::Launching::kSlowed;
    v.launching.is_next = true;
    return v;
}

/// A task of which so much GPU time remains, and nothing else.
inline model::SlotView job(int index, std::chrono::nanoseconds deadline,
                           std::chrono::nanoseconds gpu,
                           std::chrono::nanoseconds period = std::chrono::milliseconds(200)) {
    model::SlotView v = task(index, deadline - gpu, 1.0, deadline);
    v.remaining.gpu = gpu;
    v.chain.gpu = std::max(gpu, std::chrono::nanoseconds{1});
    v.period = period;
    return v;
}

/// A job on the CPU, whose GPU work can begin at `release`.
inline model::SlotView later_job(int index, std::chrono::nanoseconds release,
                                 std::chrono::nanoseconds deadline, std::chrono::nanoseconds gpu) {
    model::SlotView v = job(index, deadline, gpu);
    v.state.ranked = v.state.blocking = false;
    v.release = release;
    v.remaining.cpu = release;
    v.laxity = deadline - gpu - release;
    return v;
}

/// A job of two parts of so much GPU time each, with CPU time between them.
inline model::SlotView two_part_job(int index, std::chrono::nanoseconds deadline,
                                    std::chrono::nanoseconds gpu, std::chrono::nanoseconds cpu) {
    model::SlotView v = job(index, deadline, 2 * gpu);
    v.later.gpu = gpu;
    v.later.cpu = v.remaining.cpu = cpu;
    v.laxity -= cpu;
    return v;
}

/// A job that the GPU works for in half of its time alone.
inline model::SlotView half_busy_job(int index, std::chrono::nanoseconds deadline,
                                     std::chrono::nanoseconds alone) {
    model::SlotView v = job(index, deadline, alone / 2);
    v.remaining.idle = alone / 2;
    v.laxity = deadline - alone;
    return v;
}

inline std::vector<int> slots_of(const sched::TaskSet& set) {
    std::vector<int> slots;
    set.for_each([&](int task) { slots.push_back(task); });
    return slots;
}

/// What `self` is told beside `others`, at time 0.
inline sched::Decision decide_for(const model::SlotView& self,
                                  const std::vector<model::SlotView>& others,
                                  const config::Scheduler& scheduler) {
    std::vector<model::SlotView> tasks{self};
    tasks.insert(tasks.end(), others.begin(), others.end());
    return sched::decide(scheduler, {std::chrono::nanoseconds{0}, tasks});
}

}  // namespace urgengo::testing
