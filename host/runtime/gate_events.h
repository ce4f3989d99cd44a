// SPDX-License-Identifier: Apache-2.0
//
// What opens gates, counted for the statistics and written down for the trace: rounds that opened
// some, and parks (gate_keeper.h), with their times.
//
//   1 A round of the host's opened what was closed before it, is open after it, and carries its
//     time. Where the GPU opens a gate of the same task meanwhile, that gate counts as well.
//   2 Of the GPU's rounds the host knows how often they have opened gates since the look before,
//     how many there were since a look last saw some that did, and how long they took; not when.
//   3 A park lasts from its first call to the end of its last one. Only that last one reads what
//     the first has written: while it has not let go, no other call can be the first.
//
// Nothing here is touched where no gate is ever closed, but by parks.
//
// @threads any, if nothing else is said; takes no lock
#pragma once

#include <array>
#include <atomic>
#include <vector>

#include "host/base/clock.h"
#include "host/config/connections.h"
#include "host/observe/statistics.h"
#include "host/runtime/roster.h"
#include "host/runtime/run_records.h"

namespace urgengo::runtime {

class GateEvents {
  public:
    /// All outlive it.
    GateEvents(abi::SharedPage& page, const Roster& roster, RunRecords& records, Clock& clock);

    // --- rounds

    /// A round of the host's, around it: which gates are closed before it.
    class Round {
      public:
        /// @param time  which the gates that it opens carry (TaskSlot::gate_opened_ns)
        explicit Round(nanoseconds time) : time_(time) {}
        /// Of each active task, before the round.
        void note(const abi::TaskSlot& slot);
        /// @returns how many gates the round has opened
        std::uint32_t opened() const;

      private:
        struct Gated {
            const abi::TaskSlot* slot;
            std::uint32_t opened;
        };
        nanoseconds time_;
        std::array<Gated, config::kConnections.max> gated_;  // as many tasks have closed gates
        std::size_t num_gated_ = 0;
    };
    void round_ended(const Round& round, nanoseconds begin);
    /// What the GPU has done since the look before. By the thread of ours that opens gates
    void look_at_gpu(nanoseconds now);

    // --- parks

    /// By the first of some calls, all gates are open.
    struct Opening {
        nanoseconds begin{0}, took{0};
        bool has_gates = false;   ///< tasks were behind gates, as far as their threads know
        std::uint32_t gated = 0;  ///< tasks that had closed ones
    };
    void park_begins(const Opening& opening);
    /// A launch waits in its thread, as no gate may be closed.
    void refused() { refused_.fetch_add(1, std::memory_order_relaxed); }
    /// One of the calls is over. @returns whether it was the last: gates may be closed again
    bool park_ends();

    void add_to(observe::GateStatistics& told) const;

  private:
    struct Park {  // the one that is under way
        std::atomic<std::int64_t> begin_ns{0}, opening_ns{0};
        std::atomic<std::uint32_t> gated{0}, refused_before{0};
        std::atomic<bool> has_gates{false};
    };
    struct OfGpu {                          // as of the last look
        std::vector<std::uint32_t> opened;  // by task
        std::uint32_t rounds = 0;
        std::uint64_t rounds_us = 0;
        nanoseconds looked_at{0};
    };

    RunRecords::Park read_park() const;

    abi::SharedPage& page_;
    const Roster& roster_;
    RunRecords& records_;
    Clock& clock_;
    Park park_;
    OfGpu gpu_;
    std::atomic<std::uint32_t> refused_{0};
    std::atomic<std::uint64_t> rounds_{0}, opened_{0}, parks_{0}, ended_parks_{0};
    std::atomic<std::int64_t> opening_ns_{0}, most_opening_ns_{0}, parked_ns_{0},
        most_parked_ns_{0};
};

}  // namespace urgengo::runtime
