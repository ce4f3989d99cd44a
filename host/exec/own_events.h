// SPDX-License-Identifier: Apache-2.0
//
// Events of ours that mark where a stream is, and take no times. Each is made at its first use in a
// context, and never destroyed: it goes with that.
//
// @threads one at a time
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

#include "host/exec/progress_marks.h"
#include "host/exec/relaxed_capture_mode.h"

namespace urgengo::exec {

/// @tparam kNum  so many a context
template <std::size_t kNum>
class OwnEvents {
  public:
    /// @param context  the current one
    /// @param which    below kNum
    /// @returns the event; null if the driver refuses it, or cannot be asked about one later
    CUevent at(const DriverApi& driver, const MarkContext* context, std::size_t which) {
        if (!driver.cuEventCreate || !driver.cuEventQuery || !driver.cuEventRecord ||
            !driver.cuEventRecord_ptsz)
            return nullptr;
        auto its = std::find_if(contexts_.begin(), contexts_.end(),
                                [&](const Context& c) { return c.context == context; });
        if (its == contexts_.end()) its = contexts_.insert(its, {context, {}});
        CUevent& event = its->events[which];
        if (event) return event;
        const RelaxedCaptureMode relaxed(driver);
        if (driver.cuEventCreate(&event, CU_EVENT_DISABLE_TIMING) != CUDA_SUCCESS) event = nullptr;
        return event;
    }

  private:
    struct Context {
        const MarkContext* context = nullptr;
        std::array<CUevent, kNum> events{};
    };
    std::vector<Context> contexts_;
};

/// @returns whether the event is behind what the stream has now
inline bool record_event(const DriverApi& driver, CUevent event, CUstream stream,
                         StreamFlavor flavor) {
    const auto record = of_flavor(flavor, driver.cuEventRecord, driver.cuEventRecord_ptsz);
    return record(event, stream) == CUDA_SUCCESS;
}

}  // namespace urgengo::exec
