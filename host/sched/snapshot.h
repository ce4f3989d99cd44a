// SPDX-License-Identifier: Apache-2.0
//
// What a decision reads, and what it answers. Pure data: the same code decides live, in unit tests
// and in virtual time.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <span>

#include "host/model/slot_view.h"
#include "host/model/task_set.h"

namespace urgengo::sched {

using abi::Why;
using model::SlotView;
using model::TaskSet;
using std::chrono::nanoseconds;

/// A policy's key: the task with the smallest goes first. Ties go to the lower task index.
using Key = std::int64_t;

/// Tasks that can no longer meet their deadline rank behind all that can.
inline constexpr Key kLate = Key{1} << 62;

/// A key by some deadline, after all others' for a task that cannot meet its own any more.
constexpr Key late_last(const SlotView& v, Key deadline) {
    return v.laxity.count() >= 0 ? deadline : kLate / 2 + deadline;
}

/// Demoted tasks come after all others.
inline constexpr Key kDemoted = kLate + (kLate - 1);

/// And those that have given way for too long before all others, the longest late first.
inline constexpr Key kStarved = -kLate;

/// What a key depends on, besides the task's own view.
struct Standing {
    nanoseconds now{0};
    double lambda = 1;        ///< config::Scheduler::lambda
    bool given_up = false;    ///< Plan::given_up
    bool late_first = false;  ///< Plan::late_first
};

/// What the policy `feasible` plans (policies/feasible.h); nothing for other policies.
struct Plan {
    TaskSet given_up{};         ///< whose instances cannot be met with the others
    TaskSet late_first{};       ///< those that are late, and go before all that are in time
    TaskSet may_share{};        ///< those with whom all that go before them have time to share
    nanoseconds slack{0};       ///< by which the tightest of the kept ones is in time
    bool has_to_share = false;  ///< Load::has_to_share
    bool launching_is_scarce = false;  ///< Load::launching_is_scarce
};

/// The tasks that are on the GPU (ranked), at most abi::kMaxTasks; first the one that wants to
/// launch.
struct Snapshot {
    nanoseconds now{0};
    std::span<const SlotView> tasks;
    Plan plan{};
    /// TH_urgent of the paper, as a laxity: a task with less that is not late is truly urgent.
    /// Nothing: too few urgencies have been recorded.
    std::optional<nanoseconds> urgent_laxity{};
    int num_chains = 1;
    int num_levels = 1;  ///< stream priorities in use
    /// The one that wants to launch takes its turn at that, even where none is held for the GPU.
    bool takes_turns = false;

    const SlotView& self() const { return tasks.front(); }
};

struct Decision {
    bool admit = true;
    int rank = 0;  ///< how many of the others come before this task
    /// The policy's, of this task; where the order was not asked for, behind all.
    Key key = std::numeric_limits<Key>::max();
    TaskSet before{};        ///< those that do, as far as it was asked
    double utilization = 0;  ///< summed over those that block, plus the launch's own; of those that
                             ///< launch slowly, in the mean over their time alone
    bool blocked = false;    ///< one of those needs the GPU: what else goes must fit beside it
    int num_tasks = 1;       ///< on the GPU, this one included
    bool launches_late = false;  ///< enough of those before it launch that it would slow down
    bool others_pause = false;   ///< it may go, as those before it that should launch do not
    bool urgent = false;         ///< truly urgent
    /// Admitted whatever it and the others take of the GPU.
    bool is_free = true;
    // If it is not admitted:
    Why why = Why::kNone;
    int blocker = -1;  ///< of the tasks that it waits for, the first in order; -1: none
};

/// @source section 4.4.3 of the paper
inline bool is_urgent(const SlotView& v, const Snapshot& snapshot) {
    return snapshot.urgent_laxity && v.laxity.count() >= 0 && v.laxity < *snapshot.urgent_laxity;
}

}  // namespace urgengo::sched
