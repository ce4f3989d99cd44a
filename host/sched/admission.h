// SPDX-License-Identifier: Apache-2.0
//
// Admission: may this launch go now? All ways first rank the tasks on the GPU by the policy's key.
//
// packed (default). A launch goes when the utilisation of everything that ranks before it plus its
// own is at most pack_limit: then it fits beside them. It also goes when nothing that blocks ranks
// before it. So the most urgent task is never held, and small kernels of others fill what it
// leaves. A task that launches more slowly than the GPU executes counts for the part of the time in
// which the GPU works for it, and while it has next to nothing there its co-runners use the rest: a
// hold costs a poll at least, so what would be over sooner is not worth one. Where others slow
// its launching down that part is less, by as much (sched/estimates.cpp): with that of the profile
// seven networks that share the driver's locks kept a GPU idle that had room for all
// (tests/unit/test_sim_recorded.cpp: twice bare's misses; with it as many). Side by side kernels
// fill the GPU better (four chains of the workload together got 15 % more done than one by one,
// H200), but each is slower: so where the plan of the policy `feasible` is in time by share_slack,
// as many as share_limit allows may share, and more where chains cannot all be met one after the
// other (policies/feasible.h, 5). A task whose work is overdue waits for something that is not the
// GPU: it keeps its rank, and is no blocker. Of tasks that slow each other's launching down
// (model/launch_contention.h) the first few launch at a time (`launchers`); those that are held for
// that keep their place, and late ones count, too: nothing is lost for others while they wait.
// (Measured on an H200 with a prototype: 2.3 % misses where the paper's delayed launching has 13.9
// %, f_a 0.9.)
//
// threshold. The paper's delayed launching (section 4.4.4): while another task is truly urgent,
// those that are not wait, but for launches of less than exempt_utilization.
//
// buckets. PAAM (Enright et al., RTAS 2024): the chains' static order is cut into as many equal
// ranges as there are priorities. Of each range one request, a GPU segment, is on the GPU at a
// time, the others of the range wait for its end, the first of the order first; the first range
// runs all of its requests at once.
//
// groups. dCUDA as the paper characterises it: tasks whose utilisations complement each other form
// groups, and the groups take turns.
//
// exclusive. One task at a time, of any chain (`urgengo profile --isolated`).
//
// none. Everything goes; the rank still says at which priority.
#pragma once

#include "host/config/config.h"
#include "host/sched/contender.h"
#include "host/sched/snapshot.h"

namespace urgengo::sched {

/// @threads any; pure, takes time linear in the number of tasks on the GPU (groups: its square)
Decision decide(const config::Scheduler& scheduler, const Snapshot& snapshot);

/// @returns of a launch that urgency is lent to (lending.h): it goes, behind all others
Decision behind_all(const SlotView& self);

/// @returns those that come before the one that asks, which passes over them as their work is
///          overdue
/// @threads any; pure, takes time linear in the number of tasks on the GPU
TaskSet passed_over(const config::Scheduler& scheduler, const Snapshot& snapshot);

/// @returns which of so many equal ranges of the chains' static order this rank is in
constexpr int bucket_of(int static_rank, int num_chains, int num_ranges) {
    return num_chains > 0 ? static_rank * num_ranges / num_chains : 0;
}

}  // namespace urgengo::sched
