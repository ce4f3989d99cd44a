// SPDX-License-Identifier: Apache-2.0
//
// A task's copies as the runtime keeps them: see runtime/copies.cpp.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "host/exec/progress_marks.h"
#include "host/sched/copies.h"

namespace urgengo::runtime {

struct TaskState;

/// A linear asynchronous copy as the program asked for it.
struct Copy {
    CUdeviceptr to = 0, from = 0;  ///< or the host's addresses
    std::size_t bytes = 0;
    CUstream stream = nullptr;
    exec::StreamFlavor flavor = exec::StreamFlavor::kLegacy;
};

/// What begin_copy() says of a copy.
struct CopyTurn {
    TaskState* task = nullptr;                   ///< null: of no task, or nothing becomes of it
    std::size_t slice = 0;                       ///< bytes of all slices but the last; 0: whole
    bool holds = false;                          ///< waits for others' copies, and others for it
    const exec::MarkContext* context = nullptr;  ///< the current one, if paced; else null
};

/// Two events of ours, in one context. Never destroyed: they go with it.
struct BatchEvents {
    const exec::MarkContext* context = nullptr;
    std::array<CUevent, 2> event{};
};

struct TaskCopies {
    /// Copies count as unfinished until then, or until a wait for them; read by every thread that
    /// copies.
    std::atomic<std::int64_t> unfinished_until_ns{0};
    std::atomic<std::uint64_t> num_cut{0};
    std::atomic<bool> busy{false};  ///< some thread is at it: only that one touches the rest
    sched::CopyPace pace;
    const exec::MarkContext* context = nullptr;  ///< what `pace` is about
    std::vector<BatchEvents> events;             ///< a context each
};

}  // namespace urgengo::runtime
