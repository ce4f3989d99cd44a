// SPDX-License-Identifier: Apache-2.0
//
// What a decision reads, and what it answers. Pure data: the same code decides live, in unit tests
// and in the simulator.
#pragma once

#include <cstdint>
#include <span>

#include "host/model/slot_view.h"

namespace urgengo::sched {

using model::SlotView;
using std::chrono::nanoseconds;

/// A policy's key: the task with the smallest goes first. Ties go to the lower task index.
using Key = std::int64_t;

/// Tasks that can no longer meet their deadline rank behind all that can.
inline constexpr Key kLate = Key{1} << 62;

/// The tasks that are on the GPU (ranked), at most abi::kMaxTasks; first the one that wants to
/// launch.
struct Snapshot {
    nanoseconds now{0};
    std::span<const SlotView> tasks;

    const SlotView& self() const { return tasks.front(); }
};

struct Decision {
    bool admit = true;
    int rank = 0;            ///< how many of the others come before this task
    double utilization = 0;  ///< summed over those, plus the launch's own
    bool blocked = false;    ///< one of those needs the GPU: what else goes must fit beside it
};

}  // namespace urgengo::sched
