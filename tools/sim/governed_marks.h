// SPDX-License-Identifier: Apache-2.0
//
// Progress marks in virtual time: when a task's next one is due, what it takes, and when the host
// knows of it. As host/runtime/gpu_segment.cpp and
// host/progress/batch_tracking.cpp have them.
//
// With the paper's ways of tracking (`tracking: sync`, `batched`, `overlapped`) there are none: an
// event ends each batch of launches, and is known of when the thread has waited for it. (`async`,
// where what was launched counts as executed, is not modelled.)
#pragma once

#include <cstdint>
#include <deque>

#include "tools/sim/governed_program.h"
#include "tools/sim/subject.h"

namespace urgengo::sim {

class GovernedMarks {
  public:
    /// @param late  from a mark's end to when the host sees it
    GovernedMarks(GovernedProgram& program, nanoseconds late) : program_(program), late_(late) {}
    void connect(MarkPort& port) { port_ = &port; }

    bool is_due(const SimTask& task, nanoseconds now) const;
    /// Whether a launch that has just been made is marked at once, not the next one.
    bool marks_at_once(const SimTask& task, nanoseconds last) const;
    /// Behind all that the task has launched; nothing if too many are under way.
    /// @returns what it takes of the thread
    nanoseconds emit(SimTask& task, nanoseconds now);
    struct Ended {
        SimTask& task;
        std::uint32_t sequence;
    };
    /// On the GPU. @param now  of the host's clock
    /// @returns which mark that is
    Ended ended(std::int64_t tag, nanoseconds now);
    /// What the host has come to see until now.
    void deliver(nanoseconds now);

    /// Of batches: before a launch goes, or is held.
    /// @returns the tag of the one to wait for; 0: none
    std::int64_t batch_to_wait_for(SimTask& task, bool is_held, nanoseconds now);
    /// The thread has waited for the awaited batch.
    void batch_ended(SimTask& task, nanoseconds now);
    /// The program has waited for all of the segment.
    void segment_ended(SimTask& task, nanoseconds now);

    bool are_followed() const { return program_.follows_marks(); }

  private:
    struct Seen {
        nanoseconds at;
        std::int64_t tag;
    };
    nanoseconds every(const SimTask& task, nanoseconds now) const;
    void issue(SimTask& task, std::uint32_t sequence, nanoseconds now);
    void write(SimTask& task, std::uint32_t sequence, nanoseconds time);

    GovernedProgram& program_;
    const nanoseconds late_;
    MarkPort* port_ = nullptr;
    std::deque<Seen> on_the_way_;
};

}  // namespace urgengo::sim
