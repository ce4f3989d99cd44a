// SPDX-License-Identifier: Apache-2.0
#include "host/exec/priority_pool.h"

#include <algorithm>

namespace urgengo::exec {

bool PriorityPool::make(Lane& lane, int priority) const {
    const RelaxedCaptureMode relaxed(driver_);
    // Non-blocking: the legacy stream's rules are kept by the program's own stream.
    return driver_.cuStreamCreateWithPriority(&lane.stream, CU_STREAM_NON_BLOCKING, priority) ==
               CUDA_SUCCESS &&
           driver_.cuEventCreate(&lane.before, CU_EVENT_DISABLE_TIMING) == CUDA_SUCCESS &&
           driver_.cuEventCreate(&lane.behind, CU_EVENT_DISABLE_TIMING) == CUDA_SUCCESS;
}

const PriorityPool::Lane* PriorityPool::find_or_make(const MarkContext& context, int priority,
                                                     const StreamKey& key) {
    const std::lock_guard lock(mutex_);
    auto entry = std::find_if(lanes_.begin(), lanes_.end(), [&](const Entry& e) {
        return e.key == key && e.priority == priority && e.context == context.id;
    });
    if (entry == lanes_.end()) {
        if (lanes_.size() == kMaxLanes) return nullptr;
        entry = lanes_.insert(lanes_.end(), {context.id, key, priority, {}, false});
        entry->refused = !make(entry->lane, priority);
    }
    return entry->refused ? nullptr : &entry->lane;
}

const PriorityPool::Lane* PriorityPool::fork(const MarkContext& context, int priority,
                                             CUstream stream, StreamFlavor flavor) {
    const Lane* lane = find_or_make(context, priority, stream_key(driver_, stream, flavor));
    if (!lane) return nullptr;
    const auto record = of_flavor(flavor, driver_.cuEventRecord, driver_.cuEventRecord_ptsz);
    // Refused in the middle: nothing waits for the lane yet, and the launch goes as it came.
    const bool forked = record(lane->before, stream) == CUDA_SUCCESS &&
                        driver_.cuStreamWaitEvent(lane->stream, lane->before, 0) == CUDA_SUCCESS;
    return forked ? lane : nullptr;
}

// A kernel that was refused has left nothing on the lane but the wait: joining is harmless then.
void PriorityPool::join(const Lane& lane, CUstream stream, StreamFlavor flavor) const {
    const auto wait = of_flavor(flavor, driver_.cuStreamWaitEvent, driver_.cuStreamWaitEvent_ptsz);
    if (driver_.cuEventRecord(lane.behind, lane.stream) == CUDA_SUCCESS &&
        wait(stream, lane.behind, 0) == CUDA_SUCCESS)
        return;
    // The order must hold even so. Never seen: what refuses a record has lost the context.
    driver_.cuStreamSynchronize(lane.stream);
}

}  // namespace urgengo::exec
