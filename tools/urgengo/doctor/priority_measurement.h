// SPDX-License-Identifier: Apache-2.0
//
// Which ways to a priority the GPU and its driver honour, measured.
//
//   1 A kernel of many short blocks fills the GPU for about 15 ms, on a stream of the lowest
//     priority.
//   2 Once it runs, a kernel of one block an SM is launched on another stream. Without priority it
//     waits until the first one is over; with one it gets the next blocks that end.
//   3 A way to a priority is honoured if the kernel waited less than half of what was left of the
//     first one in one of five tries. (A busy machine may keep our thread from launching in time,
//     which makes a kernel look later than it is, never earlier.)
//
// Times are the GPU's, between two events.
#pragma once

#include <string>

#include "host/base/result.h"

namespace urgengo::cli {

enum class Honoured {
    kYes,      ///< the kernel overtook
    kNo,       ///< it waited as if it had no priority
    kRefused,  ///< the driver has no such thing, or answers an error
};

/// How long the small kernel took, from when the GPU had it to its end, while the other one still
/// had so long to run.
struct PriorityWait {
    double us = 0;
    double behind_us = 0;
};

/// One way to a priority.
struct PriorityWay {
    Honoured honoured = Honoured::kRefused;
    PriorityWait wait{};  ///< the best try; 0 if refused
};

struct PriorityMeasurement {
    int least = 0;  ///< the range of priorities; the greatest is the smaller number
    int greatest = 0;
    double busy_us = 0;            ///< how long the GPU was filled
    PriorityWait plain{};          ///< without any priority, the best try
    PriorityWay launch_attribute;  ///< CU_LAUNCH_ATTRIBUTE_PRIORITY of the launch
    PriorityWay stream_attribute;  ///< the same set on a stream that exists
    PriorityWay stream;            ///< a stream created with the priority
};

/// In a child only: it makes a context and keeps the GPU busy for a quarter of a second.
/// @param library  empty: libcuda.so.1, as the loader finds it
/// @errors what the driver answered, or why the times say nothing: one line
Result<PriorityMeasurement> measure_priority(const std::string& library);

}  // namespace urgengo::cli
