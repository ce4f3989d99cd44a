// SPDX-License-Identifier: Apache-2.0
//
// What happened, per chain: counted by the runtime with relaxed atomics, read when the program
// ends.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "host/observe/miss_cause.h"
#include "host/sched/comparison.h"

namespace urgengo::observe {

/// What is counted at every launch, per task: written by one thread at a time, so without the cost
/// of an atomic addition. Summed into ChainStatistics when asked for.
struct TaskCounters {
    std::atomic<std::uint64_t> launches{0};
    std::atomic<std::uint64_t> scheduled{0};  ///< of those, decided upon; the rest only counted
    std::atomic<std::uint64_t> marks{0};
    std::atomic<std::uint64_t> marks_refused{0};
    std::atomic<std::uint64_t> holds{0};           ///< launches that had to wait for others
    std::atomic<std::uint64_t> holds_opened{0};    ///< instances that were held for all their bound
    std::atomic<std::uint64_t> unknown{0};         ///< launches of kernels that the profile lacks
    std::atomic<std::uint64_t> implicit_syncs{0};  ///< waits for all work, with some under way
    std::atomic<std::uint64_t> lent{0};            ///< launches that were held, then let go for an
                                                   ///< awaited task, which did not come
    std::atomic<std::int64_t> held_ns{0};          ///< of its threads, for others
    std::atomic<std::int64_t> paced_ns{0};  ///< for the GPU to come to what they have launched
};

/// Of a chain's instances.
struct FrameCounters {
    std::atomic<std::uint64_t> instances{0};  ///< frames that arrived
    std::atomic<std::uint64_t> finished{0};   ///< of those, came to their end
    std::atomic<std::uint64_t> missed{0};  ///< finished late, exited, or never brought to its end
    std::atomic<std::uint64_t> exited{0};  ///< ended early (early chain exit)
    std::atomic<std::uint64_t> misses_in_a_row{0};  ///< now
    std::atomic<std::uint64_t> most_misses_in_a_row{0};
    std::atomic<std::int64_t> most_late_ns{0};  ///< of those that finished
    std::atomic<std::int64_t> latency_sum_ns{0};
    std::atomic<std::int64_t> latency_max_ns{0};
    std::atomic<std::uint64_t> resyncs{0};      ///< did not go as the profile says
    std::atomic<std::uint64_t> observed{0};     ///< left alone for want of confidence
    std::atomic<std::uint64_t> stood_aside{0};  ///< not scheduled, as launching was crowded
    std::atomic<std::uint64_t> late_starts{0};  ///< came later than ever, lately
    std::atomic<std::uint64_t> early{0};        ///< came before they were due
    std::atomic<std::uint64_t> implausible{0};  ///< arrivals that no clock can have shown
};

/// How a chain's first task launches.
struct LaunchingFacts {
    std::atomic<const char*> state{"unknown"};  ///< slowed, free, unknown
    std::atomic<double> pace{1};      ///< by which the profile's launch times are multiplied
    std::atomic<double> slowdown{0};  ///< by others' launching; 0: not seen
    std::atomic<double> together{0};  ///< what they get done, in what one does alone; 0: not seen
};

struct ChainStatistics {
    std::string name;
    /// What the guard has compared last for it. Set by who asks for statistics.
    struct GuardFound {
        const char* with = "enforce";  ///< the other way; enforce is where it fell back
        sched::Finding finding;        ///< no pairs: it has compared nothing
    } guard_found;
    std::atomic<const char*> guard{"off"};  ///< what it has made of it: enforce, priorities, ...
    FrameCounters frames;
    TaskCounters tasks;                              ///< of all its tasks
    std::atomic<std::uint64_t> as_planned{0};        ///< of those scheduled, which needed no asking
    std::atomic<std::uint64_t> synchronisations{0};  ///< waits of ours, in the place of marks
    std::atomic<std::uint64_t> copies_cut{0};        ///< copies that were made in slices
    LaunchingFacts launching;
    std::vector<CauseCount> causes;  ///< of its misses, the most frequent first; when asked for
};

/// Raises a maximum.
template <typename T>
void raise_to(std::atomic<T>& maximum, T value) {
    T seen = maximum.load(std::memory_order_relaxed);
    while (value > seen && !maximum.compare_exchange_weak(seen, value, std::memory_order_relaxed)) {
    }
}

/// Adds to a counter that one thread at a time writes.
template <typename T>
void bump(std::atomic<T>& counter, T by = 1) {
    counter.store(counter.load(std::memory_order_relaxed) + by, std::memory_order_relaxed);
}

/// @returns the table for people, one line a chain, with the overall deadline miss ratio (mean over
/// chains of missed / instances)
/// @param guard  what it has done; empty: nothing
std::string to_table(const std::vector<const ChainStatistics*>& chains, const std::string& mode,
                     const std::string& guard = "");

/// Of the time in which tasks were on the GPU: how much of it bystanders launched often in, and how
/// much of that they were busy in, so that no launch was held (sched/bystanders.h).
struct BystanderStatistics {
    double seconds = 0, often_s = 0, busy_s = 0;
};

/// Gates (runtime/gates.h), and who opened them.
struct GateStatistics {
    std::uint64_t closed = 0, opened_by_gpu = 0;
    std::uint64_t refused = 0;  ///< launches that waited in their thread, as there was no gate free
    std::uint64_t parks = 0;    ///< calls before which all gates were opened
    double park_us = 0, most_park_us = 0;  ///< mean and most that opening them took
    /// Mean and most for which none could be closed then: the calls' own time.
    double parked_us = 0, most_parked_us = 0;
    std::uint64_t host_rounds = 0, opened_by_host = 0;  ///< that opened gates, and how many gates
    std::uint64_t past_bound = 0;  ///< tasks whose last gate opened later than it had to
    double most_past_us = 0;
    std::uint64_t gpu_rounds = 0;
    double gpu_round_us = 0;      ///< mean
    std::uint64_t forsaken = 0;   ///< leases that opened all gates, as the host was silent
    double urgent_laxity_us = 0;  ///< TH_urgent, as the GPU's rounds found it; 0: not known
};

/// @returns the same as JSON
/// @param warnings  lines: what a run should tell (runtime/report.h)
std::string to_json(const std::vector<const ChainStatistics*>& chains, const std::string& mode,
                    const std::string& tripped, const std::string& guard = "",
                    const BystanderStatistics& bystanders = {}, const GateStatistics& gates = {},
                    const std::vector<std::string>& warnings = {});

}  // namespace urgengo::observe
