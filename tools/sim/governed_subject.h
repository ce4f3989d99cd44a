// SPDX-License-Identifier: Apache-2.0
//
// Chains governed by sched::Governor: the object files that decide live, on the simulator's clock.
// The order in which it is told and asked is the runtime's (launch_path.cpp, gpu_segment.cpp):
//
//   arrived -> exits? -> task_begins -> launch ... launch -> wait_begins -> task_ends ->
//   frame_ended
//
//   launch: the first enters the GPU segment; a mark if one is due; then the Governor is asked. A
//           launch that waits is asked about again when it has slept as it was told: a sleep ends
//           by time alone, as the runtime's does.
//
// Of a chain whose frames arrive with their first calls nothing is told before the first launch:
// which frame that is of, and since when it has been there, is reckoned from when the thread has
// waited last and has computed since (sched/backlog.h). That its instances end with the waits
// that the profile says is taken for granted (model/instance_tracker.h).
//
// What it leaves out of the runtime: launches that go unasked as planned (the Governor would let
// them), the GPU's position within kernels (no decision reads it), and marks that are spared where
// a program alone launches more slowly than the GPU executes.
#pragma once

#include <memory>
#include <string>

#include "host/sched/backlog.h"
#include "tools/sim/governed_gates.h"
#include "tools/sim/governed_marks.h"
#include "tools/sim/governed_program.h"
#include "tools/sim/governed_streams.h"
#include "tools/sim/subject.h"

namespace urgengo::sim {

class GovernedSubject : public Subject {
  public:
    /// @param profile    of all chains, in the config's order
    /// @param mark_late  from a mark's end on the GPU to when the host sees it
    GovernedSubject(const config::Config& config, const config::Profile& profile,
                    nanoseconds mark_late = sched::kMarkVisible);

    void connect(MarkPort& port) override { marks_.connect(port); }
    void connect_gates(GatePort& port) override { gates_.opener().connect(port); }
    void bystander_launched(nanoseconds now) override;
    void arrived(int chain, nanoseconds arrival, nanoseconds now) override;
    bool exits(Place at, nanoseconds arrival, nanoseconds now) override;
    void task_begins(Place at, nanoseconds arrival, nanoseconds now) override;
    LaunchAnswer launch(Place at, nanoseconds now) override;
    void launched(Place at, nanoseconds now) override;
    void joined(Place at, int branch, int other, nanoseconds now) override;
    void wait_begins(Place at, nanoseconds now) override;
    void task_ends(Place at, nanoseconds now) override;
    void frame_ended(int chain, nanoseconds latency, nanoseconds now) override;
    void mark_ended(int chain, std::int64_t tag, nanoseconds now) override;
    void park_begins(nanoseconds now) override;
    void park_ends(nanoseconds now) override;
    void woken(int what, nanoseconds now) override;

    int num_connections() const override { return kConnections; }
    std::string description() const override { return "scheduling"; }
    std::optional<GateCounts> gate_counts() const override;

    /// @returns for how long a frame of the chain has been held for others, at most
    nanoseconds longest_hold(int chain) const {
        return longest_hold_[static_cast<std::size_t>(chain)];
    }

  private:
    /// Of a chain without hints.
    struct Thread {
        nanoseconds woke{0};    ///< with the frame at hand
        nanoseconds waited{0};  ///< when its last wait ended; 0: none did
        sched::Backlog backlog;
        nanoseconds arrival{0};   ///< of the frame at hand, as far as is known
        bool is_at_task = false;  ///< its instance has begun
    };
    Thread& thread(int chain) { return threads_[static_cast<std::size_t>(chain)]; }
    void begin_by_first_call(Place at, nanoseconds now);
    SimTask& task_at(Place at) const { return program_.task(at.chain, at.task); }
    /// @returns what it takes of the thread
    nanoseconds mark_if_worth_it(SimTask& task, nanoseconds now);
    nanoseconds& owed(const SimTask& task) { return owed_[task.chain->index]; }
    LaunchAnswer go_behind_gates(SimTask& task, GovernedGates::Taken taken, nanoseconds now);
    LaunchAnswer decide(SimTask& task, nanoseconds now);
    LaunchAnswer look_again(SimTask& task, nanoseconds now);
    sched::Answer ask(SimTask& task, nanoseconds now);
    LaunchAnswer sleep(SimTask& task, nanoseconds now);
    LaunchAnswer go(SimTask& task, const sched::Decision& decision, nanoseconds now);
    LaunchAnswer wait_for_batch(std::int64_t tag) const;
    bool vouches(const SimTask& task) const {
        return streams::vouches(task, program_.follows_marks());
    }
    void make_visible(SimTask& task, const sched::Wait& wait, nanoseconds now);

    GovernedProgram program_;
    GovernedMarks marks_;
    GovernedGates gates_;
    // By chain:
    std::vector<nanoseconds> owed_;  ///< CPU time of marks since its last launch
    std::vector<nanoseconds> held_;  ///< in the frame at hand
    std::vector<nanoseconds> longest_hold_;
    std::vector<Thread> threads_;
    std::vector<bool> waits_for_all_;  ///< its thread is in such a wait
};

}  // namespace urgengo::sim
