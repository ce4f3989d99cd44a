// SPDX-License-Identifier: Apache-2.0
//
// Is a stream being captured into a graph? Nothing of ours may then go into it. Counts the captures
// that are under way, and asks the driver about a stream only while there are any.
#pragma once

#include <atomic>

#include "host/exec/driver_api.h"

namespace urgengo::exec {

class Captures {
  public:
    explicit Captures(const DriverApi& driver) : driver_(driver) {}

    void began() { active_.fetch_add(1, std::memory_order_relaxed); }
    void ended() {
        int active = active_.load(std::memory_order_relaxed);
        // Never below zero: the capture may have begun before we looked.
        while (active > 0 &&
               !active_.compare_exchange_weak(active, active - 1, std::memory_order_relaxed)) {
        }
    }

    /// @returns whether any is under way
    bool any() const { return active_.load(std::memory_order_relaxed) > 0; }

    /// @returns whether to keep out of `stream`: it is being captured, or the driver cannot say (as
    /// for the legacy stream while another one captures)
    bool is_capturing(CUstream stream, StreamFlavor flavor) const {
        if (active_.load(std::memory_order_relaxed) == 0) [[likely]]
            return false;
        const auto ask =
            of_flavor(flavor, driver_.cuStreamIsCapturing, driver_.cuStreamIsCapturing_ptsz);
        CUstreamCaptureStatus status = CU_STREAM_CAPTURE_STATUS_NONE;
        return !ask || ask(stream, &status) != CUDA_SUCCESS ||
               status != CU_STREAM_CAPTURE_STATUS_NONE;
    }

  private:
    const DriverApi& driver_;
    std::atomic<int> active_{0};
};

}  // namespace urgengo::exec
