// SPDX-License-Identifier: Apache-2.0
//
// Launches behind gates in virtual time: which of a task's launches close one, and which go behind
// those that are closed, as runtime/gates.h has it and by the same rules (sched/gate_groups.h). Who
// opens them: gate_opener.h.
//
// A launch that finds too much behind the gates sleeps, and is asked about again, where the
// runtime's thread sleeps in its call.
#pragma once

#include "tools/sim/gate_opener.h"

namespace urgengo::sim {

class GovernedGates {
  public:
    /// Both outlive it.
    GovernedGates(GovernedProgram& program, GovernedMarks& marks)
        : program_(program), marks_(marks), opener_(program, marks) {}

    enum class Taken {
        kNot,     ///< no gate is closed: it is asked about as any other
        kGoes,    ///< behind the last gate, by SimTask::Gates::decision
        kSleeps,  ///< until look_again()
    };
    /// A launch of the task. @param[out] owed  what it takes of the thread besides
    Taken takes(SimTask& task, nanoseconds now, nanoseconds& owed);
    /// The same, of one that has slept (SimTask::Gates::awaited).
    Taken look_again(SimTask& task, nanoseconds now, nanoseconds& owed);
    /// A launch that is to wait. @returns whether it goes, behind a gate that was closed for it
    bool close(SimTask& task, const sched::Answer& answer, nanoseconds now, nanoseconds& owed);

    /// Any mark of a task. @returns what it takes of the thread
    nanoseconds mark(SimTask& task, nanoseconds now, abi::MarkRanks ranks = abi::MarkRanks::kNever);

    GateOpener& opener() { return opener_; }
    const GateOpener& opener() const { return opener_; }

  private:
    bool is_beside(const SimTask& task) const;
    bool put(SimTask& task, nanoseconds now, nanoseconds& owed);
    void rank_anew(SimTask& task, nanoseconds now);
    Taken wait_until_open(SimTask& task, std::uint32_t gate, nanoseconds now, nanoseconds& owed);
    Taken waited(SimTask& task, nanoseconds now, nanoseconds& owed);

    GovernedProgram& program_;
    GovernedMarks& marks_;
    GateOpener opener_;
};

}  // namespace urgengo::sim
