// SPDX-License-Identifier: Apache-2.0
//
// A chain as launches are known by it, and its frames: those that hints tell of, and those that are
// handed on from one of its tasks to the next.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "host/observe/statistics.h"
#include "host/sched/governed.h"

namespace urgengo::identity {

using std::chrono::nanoseconds;

struct ChainState;

/// An instance without hints that is somewhere between its chain's tasks.
struct ChainPassage {
    nanoseconds arrival{0};
    std::size_t next_stage = 0;  ///< the task that has not begun yet
    bool running = false;        ///< the one before it has not ended yet
    nanoseconds finished{0};     ///< when it has
};

/// One frame's passage through one chain, by hints.
struct Instance {
    std::uint64_t token = 0;  ///< 0: none
    ChainState* chain = nullptr;
    nanoseconds arrival{0};
};

struct ChainState : sched::GovernedChain {
    observe::ChainStatistics statistics;
    std::vector<ChainPassage> passages;  ///< under Runtime::instances_mutex_

    /// A frame has come to it.
    /// @param waited  when a launch of any chain waited last
    void entered(nanoseconds arrival, nanoseconds waited) {
        statistics.instances.fetch_add(1, std::memory_order_relaxed);
        last_arrival_ns.store(arrival.count(), std::memory_order_relaxed);
        if (expectation.arrived(arrival, config.period, waited))
            statistics.late_starts.fetch_add(1, std::memory_order_relaxed);
        if (bandwidth.arrived(arrival, config.period).count() > 0)
            statistics.early.fetch_add(1, std::memory_order_relaxed);
    }
    // One more frame has come to its end in time, or has not:
    void met() { misses_in_a_row.store(0, std::memory_order_relaxed); }
    void missed() {
        statistics.missed.fetch_add(1, std::memory_order_relaxed);
        observe::raise_to(statistics.most_misses_in_a_row,
                          misses_in_a_row.fetch_add(1, std::memory_order_relaxed) + 1);
    }
};

}  // namespace urgengo::identity
