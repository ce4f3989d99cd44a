// SPDX-License-Identifier: Apache-2.0
//
// Copies as tasks and threads have them: see runtime/copies.cpp.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

#include "host/exec/copy_slices.h"
#include "host/exec/own_events.h"
#include "host/exec/published_copies.h"
#include "host/sched/copies.h"

namespace urgengo::runtime {

using exec::Copy;
struct TaskState;

/// What Copies::begin() says of a copy.
struct CopyTurn {
    TaskState* task = nullptr;                   ///< null: of no task, or nothing becomes of it
    std::size_t slice = 0;                       ///< bytes of all slices but the last; 0: whole
    bool holds = false;                          ///< waits for others' copies, and others for it
    bool paces = false;                          ///< no more than two slices are under way
    const exec::MarkContext* context = nullptr;  ///< the current one, if events can be had
    bool has_place = false;
    exec::PublishedCopies::Place place;  ///< then
    CUevent reached = nullptr;           ///< then: see exec::PublishedCopies::Events
};

/// Where events lie: behind pieces, before copies at their places, and behind those.
struct CopyEvents {
    static constexpr std::size_t kPiece = 0, kReached = sched::CopyPace::kMaxUnderWay,
                                 kEnd = kReached + exec::PublishedCopies::kPlaces,
                                 kNum = kEnd + exec::PublishedCopies::kPlaces;
};

/// What others may still wait for: the last copy of a thread.
struct CopyOfThread {
    TaskState* task = nullptr;  ///< whose it was; null: none
    exec::PublishedCopies::Ticket ticket;
    CUstream stream = nullptr;
    exec::StreamFlavor flavor = exec::StreamFlavor::kLegacy;
};

struct TaskCopies {
    exec::PublishedCopies published;
    std::atomic<std::uint64_t> num_cut{0};
    std::atomic<bool> busy{false};  ///< a thread is at it: only that thread touches the rest
    sched::CopyPace pace;
    const exec::MarkContext* context = nullptr;  ///< what `pace` is about
    exec::OwnEvents<CopyEvents::kNum> events;
};

}  // namespace urgengo::runtime
