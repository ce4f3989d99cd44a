// SPDX-License-Identifier: Apache-2.0
//
// What marks cost on the GPU, measured where a program is traced, so that readers of kernels timed
// by marks (exec/kernel_timer.h) can take it off.
//
//   mark M1 | pause | mark M2                     from stamp to stamp: mark
//   mark M1 | pause | kernel | pause | mark M2    from stamp to stamp: mark + kernel + pause
//
//  1 `mark` is a mark itself and one pause: the step between marks that follow one another.
//  2 A kernel between two marks has two pauses. The second is found with a kernel of known length
//    between marks, the delay of device/marks.cu. Two lengths must give the same pause.
//  3 A kernel takes longer than its instructions: its start and its end are in what the GPU (and
//    CUPTI) calls its time, but not in what the delay was told to take (kDelayBeyondSpin).
#pragma once

#include <chrono>

#include "host/exec/progress_marks.h"

namespace urgengo::exec {

/// What CUPTI calls the delay kernel's time, less what it was told to take: its start until the
/// first reading of the clock, and its end behind the last. Without it kernels of 13 networks came
/// out too short by 244 ns (median; ten of them 87 to 307, three eager ones too long by 61 to 126:
/// their launches came late), H100: so much between that no network is wrong by 10 %.
inline constexpr std::chrono::nanoseconds kDelayBeyondSpin{150};

/// Zero where the driver cannot do it, or what was measured cannot be true.
struct MarkCost {
    std::chrono::nanoseconds mark{0};   ///< what a mark adds between two kernels
    std::chrono::nanoseconds pause{0};  ///< and what a kernel between two marks has besides
};

/// Takes about 10 ms. Measures on a stream of its own, behind a kernel that takes a while.
MarkCost measure_mark_cost(const ProgressMarks& marks, const MarkContext& context);

}  // namespace urgengo::exec
