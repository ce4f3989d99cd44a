// SPDX-License-Identifier: Apache-2.0
//
// How few misses there can be: a bound that no scheduler is below, even one that knows the future.
//
// 1 A frame that is in time has all its GPU work done between its first CPU segment's end and its
//   deadline: in that window. In any stretch of time the frames whose windows lie in it need no
//   more GPU time than it has; what is too much must be given up, at least those frames whose
//   misses cost the least for their work, the last one in part; and at least so many whole frames
//   as the largest ones make up for.
// 2 A frame's window lies in one of several stretches that do not overlap, at most. So what is
//   given up in each of them adds up; the bound is the greatest such sum.
// 3 A miss costs 1 / frames of its chain; frames that are given up take nothing, and a chain's
//   frames do not wait for each other. Nothing is lost between kernels of different tasks.
//
// It is a relaxation: the least may be higher. Pure.
#pragma once

#include "tools/chains/scenario.h"
#include "tools/chains/workload.h"

namespace urgengo::sim {

struct LeastMisses {
    double one_at_a_time = 0;  ///< overall miss ratio, where a kernel takes its time alone
    /// The same where each takes the work of its blocks alone, as if others filled the rest.
    double shared = 0;
};

/// @param seconds, seed  as in World
LeastMisses least_misses(const chains::Workload& workload, const chains::Scenario& scenario,
                         double seconds, std::uint32_t seed);

}  // namespace urgengo::sim
