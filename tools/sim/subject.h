// SPDX-License-Identifier: Apache-2.0
//
// What decides about the launches of simulated chains: nothing (bare), or a scheduler. All that a
// launch asks and all that it is told goes through here; a subject sees neither the GPU's model nor
// the CPU's, and no clock but the time that it is given.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "host/base/result.h"
#include "tools/chains/scenario.h"
#include "tools/chains/workload.h"
#include "tools/sim/event_queue.h"

namespace urgengo::sim {

/// A place in the program: chains and tasks by their index, the kernel by its place in the task.
struct Place {
    int chain = 0;
    int task = 0;
    std::size_t kernel = 0;
    int branch = 0;  ///< of the task's streams, the one that the kernel is on
};

/// Where UrgenGo schedules more than a few tasks (host/config/connections.h). Without it the driver
/// has eight; but the ten chains, bare on an H200, show no stream that waits for another one's
/// queue (2026-11-22_h200_presets_seeds_4_5_6.json: with eight in the model C0 takes 1.4 times as
/// long at f_a 1.3 as there, C9 0.9 times; with ten all are within a tenth).
inline constexpr int kConnections = 32;

struct LaunchAnswer {
    bool goes = true;
    int priority = 0;             ///< if it goes
    nanoseconds look_at{0};       ///< if not: when it asks again, after a sleep;
    std::int64_t until_mark = 0;  ///< not 0: when this mark has ended, and it spins until then
    nanoseconds cpu{0};  ///< what asking, and marks since the last launch, took of its thread
};

/// What a subject puts on a chain's streams of its own accord.
class MarkPort {
  public:
    virtual ~MarkPort() = default;
    /// At once.
    /// @param time  that it takes of the stream; 0: an event
    /// @param tag   not 0; Subject::mark_ended() hands it back
    virtual void mark(int chain, int branch, nanoseconds time, std::int64_t tag) = 0;
};

/// What a subject that closes gates has besides: words that streams wait for, and a clock of its
/// own.
class GatePort {
  public:
    virtual ~GatePort() = default;
    /// A gate on a stream of a chain, at once: open as soon as the word has this number.
    /// @param time  that it takes of the stream if it has already
    virtual void gate(int chain, int branch, int word, std::uint32_t number, nanoseconds time) = 0;
    /// @param late  until a stream that waits goes on
    virtual void open(int word, std::uint32_t number, nanoseconds late) = 0;
    /// Subject::woken() says `what` then.
    /// @param is_late  as a sleeping thread is
    virtual void wake_subject(nanoseconds when, int what, bool is_late) = 0;
    virtual int num_connections() const = 0;
};

/// Of a run with gates.
struct GateCounts {
    std::uint64_t closed = 0, refused = 0;  ///< refused: for want of a connection
    std::uint64_t opened_by_gpu = 0;        ///< as often, one or more at a time
    std::uint64_t gpu_rounds = 0;
    std::uint64_t at_bound = 0;  ///< as often gates of a task opened as their time had come
    // While calls that wait for all GPU work are under way, no gate is closed:
    std::uint64_t parks = 0;            ///< such calls
    std::uint64_t opened_by_parks = 0;  ///< tasks whose gates they have opened
    std::uint64_t held_by_parks = 0;    ///< launches that waited in their threads instead
    nanoseconds parked{0}, longest_park{0};
};

class Subject {
  public:
    Subject() = default;
    Subject(const Subject&) = delete;
    Subject& operator=(const Subject&) = delete;
    virtual ~Subject() = default;

    /// @param port  outlives what comes after
    virtual void connect(MarkPort& port);
    /// @param port  the same
    virtual void connect_gates(GatePort& port);

    // Told.
    /// A launch of no chain has been made.
    virtual void bystander_launched(nanoseconds now);
    virtual void arrived(int chain, nanoseconds arrival, nanoseconds now);
    virtual void task_begins(Place at, nanoseconds arrival, nanoseconds now);
    virtual void launched(Place at, nanoseconds now);
    /// What comes next on `branch` waits for all that is on `other` by now.
    virtual void joined(Place at, int branch, int other, nanoseconds now);
    /// For the task's first stream.
    virtual void wait_begins(Place at, nanoseconds now);
    virtual void task_ends(Place at, nanoseconds now);
    virtual void frame_ended(int chain, nanoseconds latency, nanoseconds now);
    /// On the GPU, just now.
    virtual void mark_ended(int chain, std::int64_t tag, nanoseconds now);
    /// A thread of no chain is about to make a call that waits for all GPU work; that has returned.
    virtual void park_begins(nanoseconds now);
    virtual void park_ends(nanoseconds now);
    /// As it has asked for.
    virtual void woken(int what, nanoseconds now);

    // Asked.
    /// Before a task: is the program told to end the frame?
    virtual bool exits(Place at, nanoseconds arrival, nanoseconds now);
    /// Before a launch, and again after every wait.
    virtual LaunchAnswer launch(Place at, nanoseconds now) = 0;

    /// CUDA_DEVICE_MAX_CONNECTIONS that the program runs with.
    virtual int num_connections() const = 0;
    /// What the program says of it: "not loaded", "scheduling".
    virtual std::string description() const = 0;
    /// @returns nothing: it closes none
    virtual std::optional<GateCounts> gate_counts() const;
};

/// @param row  bare, or a preset's name
/// @errors what is accepted
Result<std::unique_ptr<Subject>> make_subject(const std::string& row,
                                              const chains::Workload& workload,
                                              const chains::Scenario& scenario);
std::unique_ptr<Subject> make_bare();

}  // namespace urgengo::sim
