// SPDX-License-Identifier: Apache-2.0
//
// Is a stream being captured into a graph? Nothing of ours may then go into it. Knows where the
// captures that are under way began, and asks the driver about a stream only while there are any.
//
// A capture ends by its end, with the stream where it began, with that stream's context, and, on a
// per-thread default stream, with the thread; not with a thread otherwise (measured, H100, driver
// 580.159.04).
#pragma once

#include <algorithm>
#include <atomic>
#include <mutex>
#include <vector>

#include "host/exec/context_id.h"
#include "host/exec/stream_key.h"

namespace urgengo::exec {

class Captures {
  public:
    explicit Captures(const DriverApi& driver) : driver_(driver) {}

    void began(CUstream stream, StreamFlavor flavor) {
        const Origin origin{stream_key(driver_, stream, flavor), context_of(stream)};
        const std::lock_guard lock(mutex_);
        origins_.push_back(origin);
        any_.store(true, std::memory_order_relaxed);
    }
    /// Nothing if it began before we looked.
    void ended(const StreamKey& key) {
        const std::lock_guard lock(mutex_);
        // One of them: a capture that is refused, as its stream captures already, ends at once.
        const auto found = std::find_if(origins_.begin(), origins_.end(),
                                        [&](const Origin& o) { return o.key == key; });
        if (found != origins_.end()) origins_.erase(found);
        any_.store(!origins_.empty(), std::memory_order_relaxed);
    }
    /// Those that began in contexts that are no more.
    void context_ended() {
        end_if([this](const Origin& o) { return o.context.has_ended(driver_); });
    }
    /// Those that began on the calling thread's own stream.
    void thread_ends() {
        end_if([key = stream_key(driver_, CU_STREAM_PER_THREAD, StreamFlavor::kPerThread)](
                   const Origin& o) { return o.key == key; });
    }
    bool began_on(const StreamKey& key) const {
        if (!any()) return false;
        const std::lock_guard lock(mutex_);
        return std::any_of(origins_.begin(), origins_.end(),
                           [&](const Origin& o) { return o.key == key; });
    }

    /// @returns whether any is under way
    bool any() const { return any_.load(std::memory_order_relaxed); }

    /// @returns whether to keep out of `stream`: it is being captured, or the driver cannot say (as
    /// for the legacy stream while another one captures)
    bool is_capturing(CUstream stream, StreamFlavor flavor) const {
        if (!any()) [[likely]]
            return false;
        const auto ask =
            of_flavor(flavor, driver_.cuStreamIsCapturing, driver_.cuStreamIsCapturing_ptsz);
        CUstreamCaptureStatus status = CU_STREAM_CAPTURE_STATUS_NONE;
        return !ask || ask(stream, &status) != CUDA_SUCCESS ||
               status != CU_STREAM_CAPTURE_STATUS_NONE;
    }

  private:
    struct Origin {
        StreamKey key;
        ContextId context;
    };

    // A stream is mostly of the current context, but need not be.
    ContextId context_of(CUstream stream) const {
        CUcontext its = nullptr;
        if (!is_default_stream(stream) && driver_.cuStreamGetCtx &&
            driver_.cuStreamGetCtx(stream, &its) == CUDA_SUCCESS)
            return ContextId::of(driver_, its);
        return ContextId::current(driver_);
    }

    template <typename HasEnded>
    void end_if(HasEnded&& has_ended) {
        if (!any()) return;
        const std::lock_guard lock(mutex_);
        std::erase_if(origins_, has_ended);
        any_.store(!origins_.empty(), std::memory_order_relaxed);
    }

    const DriverApi& driver_;
    mutable std::mutex mutex_;
    std::vector<Origin> origins_;
    std::atomic<bool> any_{false};
};

}  // namespace urgengo::exec
