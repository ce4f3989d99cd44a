// SPDX-License-Identifier: Apache-2.0
#include "host/exec/priority_pool.h"

#include <algorithm>

namespace urgengo::exec {
namespace {

auto record_of(const DriverApi& driver, StreamFlavor flavor) {
    return flavor == StreamFlavor::kPerThread ? driver.cuEventRecord_ptsz : driver.cuEventRecord;
}

auto wait_of(const DriverApi& driver, StreamFlavor flavor) {
    return flavor == StreamFlavor::kPerThread ? driver.cuStreamWaitEvent_ptsz
                                              : driver.cuStreamWaitEvent;
}

}  // namespace

bool PriorityPool::make(Lane& lane, int priority) const {
    const RelaxedCaptureMode relaxed(driver_);
    // Non-blocking: the legacy stream's rules are kept by the program's own stream.
    return driver_.cuStreamCreateWithPriority(&lane.stream, CU_STREAM_NON_BLOCKING, priority) ==
               CUDA_SUCCESS &&
           driver_.cuEventCreate(&lane.before, CU_EVENT_DISABLE_TIMING) == CUDA_SUCCESS &&
           driver_.cuEventCreate(&lane.behind, CU_EVENT_DISABLE_TIMING) == CUDA_SUCCESS;
}

PriorityPool::Lane* PriorityPool::fork(const MarkContext& context, int priority, CUstream stream,
                                       StreamFlavor flavor) {
    const int level = context.least_priority - priority;
    if (level < 0 || level >= kMaxLevels) return nullptr;
    const auto last = contexts_.begin() + num_contexts_;
    auto lanes = std::find_if(contexts_.begin(), last,
                              [&](const Lanes& l) { return l.context == context.id; });
    if (lanes == last) {
        if (num_contexts_ == kMaxContexts) return nullptr;
        ++num_contexts_;
        lanes->context = context.id;
    }
    Lane& lane = lanes->by_level[static_cast<std::size_t>(level)];
    if (!lane.behind && !lane.refused) lane.refused = !make(lane, priority);
    if (lane.refused) return nullptr;
    // Refused in the middle: nothing waits for the lane yet, and the launch goes as it came.
    const bool forked = record_of(driver_, flavor)(lane.before, stream) == CUDA_SUCCESS &&
                        driver_.cuStreamWaitEvent(lane.stream, lane.before, 0) == CUDA_SUCCESS;
    return forked ? &lane : nullptr;
}

// A kernel that was refused has left nothing on the lane but the wait: joining is harmless then.
void PriorityPool::join(const Lane& lane, CUstream stream, StreamFlavor flavor) const {
    if (driver_.cuEventRecord(lane.behind, lane.stream) == CUDA_SUCCESS &&
        wait_of(driver_, flavor)(stream, lane.behind, 0) == CUDA_SUCCESS)
        return;
    // The order must hold even so. Never seen: what refuses a record has lost the context.
    driver_.cuStreamSynchronize(lane.stream);
}

}  // namespace urgengo::exec
