// SPDX-License-Identifier: Apache-2.0
//
// Where the GPU is: what every look at a task's progress tells of the GPU's clock.
#include "host/model/position.h"
#include "host/runtime/runtime.h"

namespace urgengo::runtime {

// By whoever has seen a mark executed first. It may be a later one by now.
void Runtime::saw_progress(TaskState& task, const ug_mark_line& line) {
    const auto mark =
        model::read_mark(line, task.slot->marks_issued.load(std::memory_order_acquire));
    const nanoseconds seen = clock_.now();  // after the look
    if (!mark || mark->stamp == UG_MARK_NO_TIME) return;
    if (__atomic_load_n(&line.clock, __ATOMIC_ACQUIRE) != UG_MARK_CLOCK_GPU) return;
    const nanoseconds launched = task.log.mark_time(mark->sequence);
    if (!task.log.still_holds(task.log.count(), mark->sequence)) return;
    gpu_clock_.add({mark->stamp, launched, seen});
}

}  // namespace urgengo::runtime
