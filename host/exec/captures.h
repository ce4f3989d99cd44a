// SPDX-License-Identifier: Apache-2.0
//
// Is a stream being captured into a graph? Nothing of ours may then go into it. Knows where the
// captures that are under way began, and asks the driver about a stream only while there are any.
#pragma once

#include <algorithm>
#include <atomic>
#include <mutex>
#include <vector>

#include "host/exec/stream_key.h"

namespace urgengo::exec {

class Captures {
  public:
    explicit Captures(const DriverApi& driver) : driver_(driver) {}

    void began(const StreamKey& origin) {
        const std::lock_guard lock(mutex_);
        origins_.push_back(origin);
        any_.store(true, std::memory_order_relaxed);
    }
    /// Nothing if it began before we looked.
    void ended(const StreamKey& origin) {
        const std::lock_guard lock(mutex_);
        // One of them: a capture that is refused, as its stream captures already, ends at once.
        const auto found = std::find(origins_.begin(), origins_.end(), origin);
        if (found != origins_.end()) origins_.erase(found);
        any_.store(!origins_.empty(), std::memory_order_relaxed);
    }
    bool began_on(const StreamKey& origin) const {
        if (!any()) return false;
        const std::lock_guard lock(mutex_);
        return std::find(origins_.begin(), origins_.end(), origin) != origins_.end();
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
    const DriverApi& driver_;
    mutable std::mutex mutex_;
    std::vector<StreamKey> origins_;
    std::atomic<bool> any_{false};
};

}  // namespace urgengo::exec
