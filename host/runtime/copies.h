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
#include "host/runtime/published_copies.h"
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
    bool paces = false;                          ///< no more than two slices are under way
    const exec::MarkContext* context = nullptr;  ///< the current one, if events can be had
    bool has_place = false;
    PublishedCopies::Place place;  ///< then
    CUevent reached = nullptr;     ///< then: see PublishedCopies::Events
};

/// Two events of ours, in one context. Never destroyed: they go with it.
struct BatchEvents {
    const exec::MarkContext* context = nullptr;
    std::array<CUevent, 2> event{};
};

/// The same for copies: behind pieces, before and behind copies at their places.
struct CopyEvents {
    static constexpr std::size_t kPiece = 0, kReached = sched::CopyPace::kMaxUnderWay,
                                 kEnd = kReached + PublishedCopies::kPlaces;
    const exec::MarkContext* context = nullptr;
    std::array<CUevent, kEnd + PublishedCopies::kPlaces> event{};
};

struct TaskCopies {
    PublishedCopies published;
    std::atomic<std::uint64_t> num_cut{0};
    std::atomic<bool> busy{false};  ///< some thread is at it: only that one touches the rest
    sched::CopyPace pace;
    const exec::MarkContext* context = nullptr;  ///< what `pace` is about
    std::vector<CopyEvents> events;              ///< a context each
};

}  // namespace urgengo::runtime
