// SPDX-License-Identifier: Apache-2.0
//
// What the dispatcher's kernels (device/dispatcher.cu) are launched with, and what they keep in the
// GPU's memory. Plain data, of the same layout for the host.
#pragma once

#include <cstdint>

#include "urgengo/abi/shared_page.h"

namespace urgengo::abi {

inline constexpr char kGateMarkKernel[] = "urgengo_gate_mark";
inline constexpr char kDispatchMarkKernel[] = "urgengo_dispatch_mark";
inline constexpr char kDispatchLeaseKernel[] = "urgengo_dispatch_lease";
inline constexpr char kDispatchArmedKernel[] = "urgengo_dispatch_armed";

/// When a mark runs a round: never, if its own task's next gate is closed, or if any gate is (its
/// task's work on the GPU ends with it). Each round that it runs, its stream waits for. A mark that
/// is told where arms are (DispatchLease) wakes one instead, for which nothing waits.
enum class MarkRanks : std::uint32_t { kNever = 0, kForItself = 1, kForAll = 2 };

/// TH_urgent (host/sched/urgent_threshold.h): steps of the histogram of the highest urgencies; how
/// far apart these are recorded; and how many records there are between two reckonings.
inline constexpr std::uint32_t kUrgentSteps = 1024;
inline constexpr std::int64_t kUrgentEvery_ns = 1'000'000;
inline constexpr std::uint32_t kUrgentEnough = 200;

/// Arms: rank kernels of an armed dispatcher, numbered from 1, each behind a wait of its stream.
/// Power of two: more than are ever under way, by as many as may end while a store to a tick is on
/// its way.
inline constexpr std::uint32_t kArmRing = 128;

/// In the GPU's memory, zero at first.
struct DispatchState {
    std::uint32_t reached[kMaxTasks];  ///< the task's last gate, as its last executed mark knew
    std::uint32_t opened[kMaxTasks];   ///< as the GPU knows: the host may have opened more
    std::uint32_t done[kMaxTasks];     ///< sequence number of its last executed mark
    std::uint32_t opens[kMaxTasks];    ///< how often the GPU has opened some of its gates
    std::uint32_t marked[kMaxTasks];   ///< 1: `done` is known
    std::uint32_t busy;                ///< 1: a round is under way
    std::uint32_t again;               ///< 1: something has changed since it began
    std::uint32_t tick;                ///< counts marks
    std::uint32_t rounds;
    std::uint64_t rounds_us;
    std::uint32_t started;  ///< number of the last arm that has begun
    // TH_urgent, as rounds of the GPU's find it:
    std::uint64_t urgent_records;
    std::int64_t urgent_recorded_ns;  ///< when the last one was, on CLOCK_MONOTONIC
    std::uint32_t urgent_counts[kUrgentSteps];
};

/// The host's memory, mapped: what is said to a leased or armed dispatcher, and what it says.
struct alignas(64) DispatchLease {
    std::uint32_t stop;               ///< the host: 1: end
    std::uint32_t launched;           ///< the host: number of the last lease that there is
    alignas(64) std::uint32_t ended;  ///< the GPU: number of the last lease or arm that ended
    std::uint32_t gaps;               ///< the GPU: how often a lease stood still (kGap_ns)
    std::uint32_t forsaken;           ///< the GPU: how often one opened all gates (kSilence_ns)
    /// Arm k waits until the word at [k % kArmRing] is k, or later. Marks and the host write it: k
    /// is all that either writes there until long after, so no store closes what another opened.
    alignas(64) std::uint32_t ticks[kArmRing];
};

/// Where the host has not beaten for so long (DispatchSettings::beat_ns), the last lease opens all
/// gates. So it stays for up to twice that beyond its end, while gates are closed and no lease
/// follows.
inline constexpr std::int64_t kSilence_ns = 10'000'000;

/// A resident kernel that does not look for so long does not run: another process has the GPU.
inline constexpr std::uint64_t kGap_ns = 500'000;

/// Of a kernel: everything by its address on the GPU.
struct DispatchArgs {
    SharedPage* page;
    DispatchState* state;
    DispatchLease* lease;
    std::uint32_t num_tasks;
    std::uint32_t reserved;
};

}  // namespace urgengo::abi
