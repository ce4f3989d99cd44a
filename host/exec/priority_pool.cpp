// SPDX-License-Identifier: Apache-2.0
#include "host/exec/priority_pool.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

#include "host/base/log.h"
#include "host/base/roomy_stack.h"
#include "host/observe/nvtx_link.h"

namespace urgengo::exec {

bool PriorityPool::make(Lane& lane, int priority) const noexcept {
    const RelaxedCaptureMode relaxed(driver_);
    // Non-blocking: the legacy stream's rules are kept by the program's own stream.
    const bool is_made =
        driver_.cuStreamCreateWithPriority(&lane.stream, CU_STREAM_NON_BLOCKING, priority) ==
            CUDA_SUCCESS &&
        driver_.cuEventCreate(&lane.before, CU_EVENT_DISABLE_TIMING) == CUDA_SUCCESS &&
        driver_.cuEventCreate(&lane.behind, CU_EVENT_DISABLE_TIMING) == CUDA_SUCCESS;
    if (const auto* tool = observe::NvtxLink::of_process(); tool && is_made) {
        std::array<char, 48> name{};  // no string: this throws nothing
        fmt::format_to_n(name.data(), name.size() - 1, "urgengo priority {}", priority);
        tool->name_stream(lane.stream, name.data());
    }
    return is_made;
}

bool PriorityPool::exists(CUstream stream) const {
    int priority = 0;
    return driver_.cuStreamGetPriority(stream, &priority) == CUDA_SUCCESS;
}

bool PriorityPool::is_idle(const Lane& lane) const {
    const RelaxedCaptureMode relaxed(driver_);
    return driver_.cuStreamQuery(lane.stream) == CUDA_SUCCESS;
}

/// @returns an entry that no stream owns: with a lane that will do, else with none; null: too many
PriorityPool::Entry* PriorityPool::unused(const MarkContext& context, int priority) {
    const auto lane = std::find_if(lanes_.begin(), lanes_.end(), [&](const Entry& e) {
        return e.context == context.id && !e.is_owned && e.priority == priority && is_idle(e.lane);
    });
    if (lane != lanes_.end()) return &*lane;
    const auto empty =
        std::find_if(lanes_.begin(), lanes_.end(), [](const Entry& e) { return e.context == 0; });
    if (empty != lanes_.end()) return &*empty;
    return lanes_.size() < kMaxLanes ? &lanes_.emplace_back() : nullptr;
}

const PriorityPool::Lane* PriorityPool::find_or_make(const MarkContext& context, int priority,
                                                     const StreamKey& key) {
    const std::lock_guard lock(mutex_);
    const auto own = std::find_if(lanes_.begin(), lanes_.end(), [&](const Entry& e) {
        return e.is_owned && e.key == key && e.priority == priority && e.context == context.id;
    });
    if (own != lanes_.end()) return own->refused ? nullptr : &own->lane;
    // Of a stream that is no more, a new one of ours could get the handle.
    if (!exists(key.stream)) return nullptr;
    Entry* const entry = unused(context, priority);
    if (!entry) {
        if (!std::exchange(told_, true))
            log_line(fmt::format(
                "launches on more than {} streams, by priority: those on others keep their own",
                kMaxLanes));
        return nullptr;
    }
    entry->key = key;
    entry->is_owned = true;
    if (entry->context == 0) {
        entry->context = context.id;
        entry->priority = priority;
        // Threads with stacks of 16 KiB died of it (H200, 580.159.04).
        on_large_stack([&] { entry->refused = !make(entry->lane, priority); });
    }
    return entry->refused ? nullptr : &entry->lane;
}

void PriorityPool::forget(const StreamKey& key) {
    const std::lock_guard lock(mutex_);
    for (Entry& e : lanes_) {
        if (!e.is_owned || e.key != key) continue;
        e.is_owned = false;
        if (e.refused) e = {};
    }
}

void PriorityPool::context_ended(unsigned long long id) {
    const std::lock_guard lock(mutex_);
    for (Entry& e : lanes_)
        if (e.context == id) e = {};
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
