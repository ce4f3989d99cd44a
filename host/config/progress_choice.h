// SPDX-License-Identifier: Apache-2.0
//
// What `progress: {source: auto}` stands for: one rule for the interposer and for `urgengo doctor`.
#pragma once

#include "host/config/config.h"

namespace urgengo::config {

/// From this compute capability on, a mark kernel is launched with programmatic serialisation: it
/// takes 0.83 us of GPU time instead of 1.7 us (H200, driver 580.159.04, 2026-11-21).
inline constexpr int kOverlappingMarksMajor = 9;

inline bool marks_overlap(int compute_major) {
    return compute_major >= kOverlappingMarksMajor;
}

/// Marks that need no thread of ours. Events cost the GPU nothing, but take 0.2 to 0.4 cores, and
/// are known of when a thread gets its turn: on four cores with four busy loops beside the ten
/// chains, 4.6 % of frames were missed with them and 1.3 % with mark kernels (f_a 0.7, H200,
/// 2026-11-23).
/// @returns a source that is not kAuto
inline ProgressSource choose_source(ProgressSource asked) {
    return asked == ProgressSource::kAuto ? ProgressSource::kKernel : asked;
}

/// @returns estimated GPU time between two marks of this source; 0: behind every launch
inline nanoseconds mark_every(const Scheduler& scheduler, ProgressSource source) {
    constexpr nanoseconds kOfEvents{50'000}, kOfOthers{100'000};
    return scheduler.progress.mark_every.value_or(source == ProgressSource::kEvent ? kOfEvents
                                                                                   : kOfOthers);
}

/// Waits for batches leave nothing to pace, and while a thread is paced it would not wait for them.
inline Scheduler paced_by_tracking(Scheduler scheduler) {
    if (scheduler.progress.tracking != Tracking::kProgress)
        scheduler.run_ahead.limit = std::chrono::hours(1);
    return scheduler;
}

}  // namespace urgengo::config
