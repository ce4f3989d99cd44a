// SPDX-License-Identifier: Apache-2.0
//
// Who opens gates, in virtual time: what runtime/gate_keeper.h and device/dispatcher.cu do. A round
// is the one that both run live (sched/dispatch_round.h); here is only when one is run, by what it
// knows of marks, and how long it takes until a stream goes on.
//
//   the host's  by a thread of ours, which looks now and then while gates are closed; as a GPU
//               segment has ended; and as a launching thread waits for its gates or ranks anew
//   the GPU's   leased: one after the other while a gate is closed. armed: after marks before a
//               gate and at a segment's end. piggyback: in those marks, for which their streams
//               wait
//
// One round of the GPU's at a time: what changes meanwhile is seen by another one. What opens by
// time alone, opens by our thread's looks.
//
// While a call is under way that waits for all GPU work, a lease is off the GPU, and no arm waits
// there.
//
// What it leaves out: rounds wait for no slot of a busy GPU, and take none from what runs beside
// them; our thread takes no core; leases do not end otherwise, and none is missing.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "host/sched/dispatch_round.h"
#include "tools/sim/governed_marks.h"
#include "tools/sim/governed_program.h"
#include "tools/sim/subject.h"

namespace urgengo::sim {

class GateOpener {
  public:
    /// Both outlive it.
    GateOpener(GovernedProgram& program, GovernedMarks& marks);
    void connect(GatePort& port) { port_ = &port; }

    bool are_on() const { return opens_by_ != config::Dispatch::kThread; }
    /// A task is about to close the first of some gates. @returns false: it must not
    bool begins();
    /// Behind what is on the task's stream. Its mark has been issued.
    void put(const SimTask& task, std::uint32_t gate, nanoseconds now);
    /// All of the task's gates are open, or are opened now.
    void ends(SimTask& task, nanoseconds now);
    /// Something has changed that no mark tells of: what may go, goes.
    void changed(nanoseconds now);
    /// The same of a GPU segment that has ended, as soon as its thread sees that.
    void segment_ended(SimTask& task, nanoseconds now);

    /// A call that waits for all GPU work is about to be made: all gates open, and none is closed
    /// before unpark().
    void park(nanoseconds now);
    void unpark(nanoseconds now);

    void mark_issued(const SimTask& task, abi::MarkRanks ranks);
    /// On the GPU, just now.
    void mark_ended(const SimTask& task, std::uint32_t sequence, nanoseconds now);
    /// @param what  of Subject::woken()
    void woken(int what, nanoseconds now);

    GateCounts counts() const;

  private:
    struct IssuedMark {
        std::uint32_t gate;  ///< the task's last one
        abi::MarkRanks ranks;
    };
    bool is_parked() const { return program_.page().dispatch.parked.load() != 0; }
    int round_word(const SimTask& task) const { return program_.num_tasks() + task.index; }
    bool is_closed(int task) const;
    bool any_closed() const;
    bool is_due(const SimTask& task, abi::MarkRanks ranks) const;
    void look(nanoseconds now);
    int run_host_round(nanoseconds now);
    void begin_gpu_round(nanoseconds from);
    void gpu_round_ends(nanoseconds now);
    void open_overdue(nanoseconds now);
    void tell(nanoseconds late, nanoseconds now);

    GovernedProgram& program_;
    GovernedMarks& marks_;
    const config::Dispatch opens_by_;
    const config::DeviceDispatch device_;
    sched::HostRounds rounds_;
    GatePort* port_ = nullptr;
    int gated_ = 0;                    ///< tasks that may have closed gates
    bool thread_looks_ = false;        ///< our thread does not sleep for want of work
    std::vector<std::uint32_t> told_;  ///< by task: the last gate that its stream knows to be open
    // What the GPU knows, and who waits for its round:
    const std::unique_ptr<abi::DispatchState> gpu_ = std::make_unique<abi::DispatchState>();
    std::vector<std::array<IssuedMark, abi::kMarkRing>> issued_;  ///< by task, sequence % kMarkRing
    struct {
        int task = -1;  ///< the mark's; -1: none waits
        std::uint32_t sequence = 0;
        int rounds = 0;  ///< that it has run
    } ranking_;
    nanoseconds parked_since_{0};
    GateCounts counts_;
};

}  // namespace urgengo::sim
