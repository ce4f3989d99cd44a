// SPDX-License-Identifier: Apache-2.0
//
// Does what was learned of a task add up? What does not is refused, or stays as a guess that says
// so: never as if it had been measured.
//
//  1 A task all of whose kernels take no time is refused.
//  2 A task that launches on several streams, and was timed by marks, is refused: what a mark on
//  one
//    stream says of the others is a guess.
//  3 The GPU cannot be busy for longer than the task takes alone. If it says so by more than a
//    tenth, the times are scaled down to that, and count as learned from no launch.
#pragma once

#include <string>

#include "host/config/config.h"

namespace urgengo::trace {

/// What is known of a task's times, beyond its profile.
struct TaskTimes {
    std::chrono::nanoseconds sum{0};              ///< the kernels' own times, overlap or not
    std::chrono::nanoseconds on_side_streams{0};  ///< and of those on branches but the first
    std::uint32_t streams = 0;                    ///< at most, in a segment
    bool by_cupti = false;
};

enum class Verdict { kAddsUp, kGuess, kRefused };

struct Check {
    Verdict verdict = Verdict::kAddsUp;
    std::string why;  ///< one line; empty if it adds up
};

/// @param task  of a kGuess the times are scaled; of a kRefused nothing is left
Check check_times(config::TaskProfile& task, const TaskTimes& times);

/// @returns the sum over its kernels: how long the GPU is busy with an instance, alone
std::chrono::nanoseconds busy_time(const config::TaskProfile& task);
/// @returns first launches to ends of waits, summed over its segments; 0: of one it is not known
std::chrono::nanoseconds latency(const config::TaskProfile& task);

}  // namespace urgengo::trace
