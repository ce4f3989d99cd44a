// SPDX-License-Identifier: Apache-2.0
//
// Who decides about the launches of simulated chains: nobody (bare), or a scheduler. All that a
// launch asks and all that it is told goes through here; a subject sees neither the GPU's model nor
// the CPU's, and no clock but the time that it is given.
#pragma once

#include <cstddef>
#include <memory>
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
};

struct LaunchAnswer {
    bool goes = true;
    int priority = 0;           ///< if it goes
    nanoseconds look_at{0};     ///< if not: when it asks again
    nanoseconds cpu{0};         ///< what asking has taken of its thread
    bool mark_behind = false;   ///< a mark follows; mark_ended() tells of it
    std::int64_t mark_tag = 0;  ///< handed back
};

class Subject {
  public:
    Subject() = default;
    Subject(const Subject&) = delete;
    Subject& operator=(const Subject&) = delete;
    virtual ~Subject() = default;

    // Told.
    virtual void arrived(int chain, nanoseconds arrival, nanoseconds now);
    virtual void task_begins(Place at, nanoseconds arrival, nanoseconds now);
    virtual void launched(Place at, nanoseconds now);
    virtual void wait_begins(Place at, nanoseconds now);
    virtual void task_ends(Place at, nanoseconds now);
    virtual void frame_ended(int chain, nanoseconds latency, nanoseconds now);
    virtual void mark_ended(int chain, std::int64_t tag, nanoseconds now);

    // Asked.
    /// Before a task: is the program told to end the frame?
    virtual bool exits(Place at, nanoseconds arrival, nanoseconds now);
    /// Before a launch, and again after every wait.
    virtual LaunchAnswer launch(Place at, nanoseconds now) = 0;

    /// CUDA_DEVICE_MAX_CONNECTIONS that the program runs with.
    virtual int num_connections() const = 0;
    /// What the program says of it: "not loaded", "scheduling".
    virtual std::string description() const = 0;
};

/// @param row  of `urgengo sim --rows`
/// @errors what is accepted
Result<std::unique_ptr<Subject>> make_subject(const std::string& row,
                                              const chains::Workload& workload,
                                              const chains::Scenario& scenario);

}  // namespace urgengo::sim
