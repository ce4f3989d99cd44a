// SPDX-License-Identifier: Apache-2.0
//
// Learns a profile from a trace: what each task of a config launches, how long that takes alone on
// the GPU, and how it is cut into segments.
//
//  1 The typical instance is the most frequent one, by the names of its launches and its segments.
//    If none stands out, it is one with the median number of launches.
//  2 A position's time is learned from the instances that are like the typical one. Where the size
//    varies from frame to frame it is the mean over them, each as its size takes.
//  3 Sizes are the look-up by name, grid and block, over all instances. A kernel that the typical
//    instance launches several times at one size takes the mean of those positions: they may differ
//    by what the size does not say.
//  4 A position's time is what the instance's busy time grows by with it (busy_time.h). Launch
//  times
//    and latencies are from a second run, in which nothing is timed (pace_learner.h); in the end
//    both must add up (profile_check.h).
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "host/config/config.h"
#include "tools/trace/instances.h"
#include "tools/trace/pace_learner.h"
#include "tools/trace/profile_check.h"
#include "tools/trace/trace_reader.h"

namespace urgengo::trace {

/// What was found of one task, beyond what its profile says.
struct TaskReport {
    std::string chain;
    std::string task;
    Boundaries boundaries = Boundaries::kNone;
    std::size_t num_launches = 0;  ///< of the task, all told; 0: it was not found
    std::size_t irregular_launches = 0;
    std::size_t unmarked_launches = 0;   ///< in instances, with no known time
    std::size_t samples = 0;             ///< launches in instances whose time is known
    std::size_t clean_samples = 0;       ///< and of those without contention
    std::chrono::nanoseconds period{0};  ///< measured; 0: not known
    TaskTimes times;
    Verdict verdict = Verdict::kAddsUp;
    std::size_t discarded_instances = 0;  ///< of which CUPTI's records are not all there
    Pace pace;                            ///< of the run without any tool, if there was one
};

struct LearnedProfile {
    config::Profile profile;
    std::vector<TaskReport> tasks;      ///< as in the profile, over all chains
    std::vector<std::string> warnings;  ///< one line each; the trace's own come first
};

/// Fewer instances than this are a warning.
inline constexpr std::uint32_t kFewInstances = 5;

/// @param program  file name of what was run, without its folder
/// @param plain    of another run of it, in which nothing was timed: for launch times, latencies
///                 and CPU times (pace_learner.h); null: those stay unknown, but CPU times are
///                 those of the timed run
LearnedProfile learn_profile(const Trace& trace, const config::Config& config,
                             const std::string& program, const Trace* plain = nullptr);

/// @returns the names of the threads that launched, with their launch counts: "a (120), b (7)";
///          at most `max_names`, the busiest first
std::string describe_threads(const Trace& trace, std::size_t max_names = 12);

}  // namespace urgengo::trace
