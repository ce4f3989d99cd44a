// SPDX-License-Identifier: Apache-2.0
//
// The one class that the interposer calls. It follows the program's instances, tells every launch
// whether and at which priority it may go, holds it if not, and keeps the progress marks coming.
//
// Threads: every function is called in the program's threads. The path of a kernel's launch takes
// no lock and allocates nothing, but where the priority goes by a stream (config: priority_via); a
// graph's launch, and the begin and end of an instance (a few a frame), take a mutex. Decisions are
// pure code in host/sched.
//
//   launch_path.h      a launch, from the question to the mark
//   planned_launches.h launches that need no asking (as_planned.h: as their thread makes them)
//   waits.h            waits that end a segment, and events
//   resolver.h         whose launch it is
//   frames.h           begins and ends of instances
//   work_on_streams.h  which streams and events carry whose work
//   runs.h             which thread has taken a task, whose run it is; jumps out of a hold
//   (recovery.cpp) gpu_segments.h     from the first launch to the last mark, or the paper's waits
//   (tracking.cpp) implicit_syncs.h   calls that wait for all GPU work copies.h           copies in
//   slices common.h           what all of these share: tasks (roster.h), where the GPU is
//                      (task_progress.h), the Governor, the guard, marks, streams, the trace
//   report.h           what is told of it all
//   chain_status.h     and while it runs; steering.h: what it is told (reloading.h: of its config)
//
// Each owns its state, and knows those below it. The interposer calls them through this one.
//
// Rules that keep a hold harmless (host/README.md): it ends by GPU progress or by time;
// only launches are held, and copies if asked for; what holds may add to one instance is bounded;
// switching the runtime off ends every hold within one poll.
#pragma once

#include <atomic>

#include "host/runtime/contexts.h"
#include "host/runtime/copies.h"
#include "host/runtime/launch_path.h"
#include "host/runtime/report.h"
#include "host/runtime/steering.h"
#include "host/runtime/waits.h"

namespace urgengo::runtime {

class Runtime {
  public:
    /// @param driver, clock, trace  outlive the runtime
    /// @param test_holds  not 0: seed of holds at random, for tests
    /// @param share   where other programs find what is told of this one; by default nowhere
    /// @param record  and what is written down of it
    Runtime(const config::ResolvedConfig& resolved, const exec::DriverApi& driver, Clock& clock,
            TraceOptions trace = {}, std::uint64_t test_holds = 0,
            const observe::ShareOptions& share = {}, const observe::RecordOptions& record = {});

    /// Frames are only counted, for good, as something of ours has failed. Any thread.
    void trip() {
        steering_.never_again(config::Mode::kObserve);  // ends every hold
        common_.gate_keeper.trip();
        common_.observers.records.tripped(common_.clock.now());
        common_.status.tripped();
        common_.observers.nvtx.tripped();
    }
    /// It has failed again: not even that is done. Any thread.
    void stop() {
        steering_.never_again(config::Mode::kOff);
        common_.status.tripped();
    }
    /// What `urgengo ctl` asks for.
    Steering& steering() { return steering_; }
    /// What it does: off, observe, enforce or shadow.
    abi::StatusMode mode() const { return observe::to_status(common_.mode()); }

    /// Launches that are asked about, and those that need no asking.
    LaunchPath& launches() { return launches_; }
    PlannedLaunches& planned() { return planned_; }
    Waits& waits() { return waits_; }
    /// Hints of where instances begin and end.
    Frames& frames() { return frames_; }
    /// NVTX ranges.
    Resolver& resolver() { return resolver_; }
    /// Events that streams wait for, or that are gone; streams that are gone.
    WorkOnStreams& work_on_streams() { return work_on_streams_; }
    Copies& copies() { return copies_; }

    /// A graph was made executable.
    void graph_instantiated(CUgraphExec executable, CUgraph graph);

    /// Captures, priorities of streams, and streams of ours: the calls that are about these alone.
    exec::ProgramStreams& streams() { return common_.streams; }
    /// What goes with modules and contexts. A small handle to it.
    Contexts contexts() { return Contexts(common_); }

    /// Where the interposer notes that a launch of no chain was made, without asking.
    /// @param launched  outlives the runtime; set by any thread, cleared here
    void watch_bystanders(std::atomic<bool>& launched) {
        common_.governor.bystanders().watch(launched);
    }

    /// The thread has jumped out of a held launch, which never came to its end.
    void jumped_out_of_hold(ThreadState& thread);

    /// The thread ends: its task, if any, is free again.
    void thread_exit(ThreadState& thread);
    /// What graphs and unloading are told that changes nothing else.
    identity::Kernels& kernels() { return common_.kernels; }

    /// Where the GPU is.
    TaskProgress& progress() { return common_.progress; }

    /// From here on another NVTX tool is told what happens. Once.
    void show_in_nvtx(std::unique_ptr<observe::NvtxLink> link);
    /// What watches: records, causes, what the tool is told.
    Observers& observers() { return common_.observers; }

    Report& report() { return report_; }
    /// What other programs see of this one.
    observe::StatusPage& status() { return common_.status; }
    /// At the program's end: what is still to come into the trace.
    void finish_trace() { common_.tracer.finish(); }
    LiveGuard& guard() { return common_.guard; }
    /// Before and after calls that wait for all GPU work.
    GateKeeper& gate_keeper() { return common_.gate_keeper; }

  private:
    Common common_;
    GpuSegments segments_;
    ImplicitSyncs syncs_;
    Runs runs_;
    Frames frames_;
    Reloading reloading_;
    Steering steering_;
    WorkOnStreams work_on_streams_;
    Resolver resolver_;
    Waits waits_;
    PlannedLaunches planned_;
    Gates gates_;
    LaunchPath launches_;
    Report report_;
    Copies copies_;
};

}  // namespace urgengo::runtime
