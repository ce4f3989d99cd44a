// SPDX-License-Identifier: Apache-2.0
//
// Who lets launches go that have to wait (config: dispatch), where what was asked for cannot be
// had.
#pragma once

#include <cstddef>
#include <string>

#include "host/config/config.h"
#include "host/config/progress_choice.h"

namespace urgengo::config {

/// Connections left for streams without gates, UrgenGo's among them.
inline constexpr int kUngatedConnections = 2;

struct DispatchChoice {
    Dispatch where = Dispatch::kThread;
    std::string why_thread;    ///< though something else was asked for
    bool is_for_tool = false;  ///< that is the reason
};

/// What makes launches wait for each other that the program does not.
struct Serialised {
    bool launches_block = false;  ///< CUDA_LAUNCH_BLOCKING
    const char* tool = nullptr;   ///< base/serialising_tool.h; null: none
};

/// @param connections  hardware connections of the process
inline DispatchChoice choose_dispatch(const Scheduler& s, const Serialised& serialised,
                                      std::size_t num_tasks, int connections) {
    const auto thread = [](const char* why) { return DispatchChoice{Dispatch::kThread, why}; };
    if (s.dispatch.where == Dispatch::kThread) return thread("");
    if (s.admission != Admission::kPacked) return thread("gates are for admission: packed");
    if (s.progress.tracking != Tracking::kProgress)
        return thread("gates are for tracking: progress");
    if (choose_source(s.progress.source) != ProgressSource::kKernel)
        return thread("gates need progress marks by kernels");
    if (serialised.launches_block) return thread("CUDA_LAUNCH_BLOCKING is set");
    if (serialised.tool)
        return {Dispatch::kThread,
                std::string(serialised.tool) + " is there, which may run kernels one at a time",
                true};
    // A closed gate keeps its connection.
    if (s.dispatch.where == Dispatch::kAuto &&
        static_cast<int>(num_tasks) > connections - kUngatedConnections)
        return thread("auto needs a connection for each task and two more");
    return {s.dispatch.where, ""};
}

}  // namespace urgengo::config
