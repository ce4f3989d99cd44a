// SPDX-License-Identifier: Apache-2.0
//
// A chain with what became of its frames.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "host/observe/statistics.h"
#include "host/sched/governed.h"

namespace urgengo::identity {

using std::chrono::nanoseconds;

struct ChainState;

/// One frame's passage through one chain, by hints.
struct Instance {
    std::uint64_t token = 0;  ///< 0: none
    ChainState* chain = nullptr;
    nanoseconds arrival{0};
};

struct ChainState : sched::GovernedChain {
    observe::ChainStatistics statistics;
    /// By chain: launches that would have waited for it (abi::StatusMode::kShadow).
    std::vector<std::atomic<std::uint64_t>> would_wait_for;

    /// A frame has come to it.
    /// @param waited  when a launch of any chain waited last
    void entered(nanoseconds arrival, nanoseconds waited) {
        statistics.frames.instances.fetch_add(1, std::memory_order_relaxed);
        last_arrival_ns.store(arrival.count(), std::memory_order_relaxed);
        if (expectation.arrived(arrival, period(), waited))
            statistics.frames.late_starts.fetch_add(1, std::memory_order_relaxed);
        if (bandwidth.arrived(arrival, period()).count() > 0)
            statistics.frames.early.fetch_add(1, std::memory_order_relaxed);
    }
    /// A frame has come to its end.
    void finished(nanoseconds arrival, nanoseconds now) {
        const nanoseconds latency = now - arrival;
        statistics.frames.finished.fetch_add(1, std::memory_order_relaxed);
        expectation.ended(now);
        latency > deadline() ? missed() : met();
        statistics.frames.latency_sum_ns.fetch_add(latency.count(), std::memory_order_relaxed);
        observe::raise_to(statistics.frames.latency_max_ns, std::int64_t{latency.count()});
        observe::raise_to(statistics.frames.most_late_ns,
                          std::int64_t{(latency - deadline()).count()});
    }
    /// A frame was given up at its task's begin: its program ends it early.
    void exited(nanoseconds arrival, nanoseconds now) {
        statistics.frames.exited.fetch_add(1, std::memory_order_relaxed);
        missed();
        statistics.frames.finished.fetch_add(1, std::memory_order_relaxed);
        expectation.launched(arrival, now);
    }
    // One more frame has come to its end in time, or has not:
    void met() { misses_in_a_row.store(0, std::memory_order_relaxed); }
    void missed() {
        statistics.frames.missed.fetch_add(1, std::memory_order_relaxed);
        observe::raise_to(statistics.frames.most_misses_in_a_row,
                          misses_in_a_row.fetch_add(1, std::memory_order_relaxed) + 1);
    }
};

}  // namespace urgengo::identity
