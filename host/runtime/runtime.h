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
//   launch_path.cpp  a launch, from the question to the mark      resolve.cpp    whose launch it is
//   as_planned.cpp   launches that need no asking (as_planned.h: as their thread makes them)
//   gpu_segments.cpp  from the first launch to the last mark       instances.cpp  begins and ends
//   waits.cpp        waits that end a segment
//   estimates.cpp    what sched/estimates.h is told, and says
//   streams.cpp      a task over several streams
//   tracing.h        what is written into a trace                 runtime.cpp    the rest
//   tracking.cpp     the paper's waits, in the place of marks
//   recovery.cpp     jumps out of a hold
//
// Rules that keep a hold harmless (host/README.md): it ends by GPU progress or by time;
// only launches are held, and copies if asked for; what holds may add to one instance is bounded;
// switching the runtime off ends every hold within one poll.
#pragma once

#include <atomic>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "host/exec/cheap_waits.h"
#include "host/runtime/calls.h"
#include "host/runtime/common.h"
#include "host/runtime/copies.h"
#include "host/runtime/estimates.h"
#include "host/runtime/frames.h"
#include "host/runtime/gpu_segments.h"
#include "host/runtime/random_holds.h"
#include "host/runtime/report.h"
#include "host/runtime/resolver.h"
#include "host/runtime/runs.h"
#include "host/runtime/thread_state.h"
#include "host/runtime/work_on_streams.h"

namespace urgengo::runtime {

class Runtime {
  public:
    /// @param driver, clock, trace  outlive the runtime
    /// @param test_holds  not 0: seed of holds at random, for tests
    Runtime(const config::ResolvedConfig& resolved, const exec::DriverApi& driver, Clock& clock,
            TraceOptions trace = {}, std::uint64_t test_holds = 0);

    /// Off: nothing is held or changed any more, for good or until switched on again. Any thread.
    void set_mode(config::Mode mode) {
        common_.governor.set_mode(mode);
        common_.guard.pause();
        common_.governor.tasks().changed();
    }
    config::Mode mode() const { return common_.governor.mode(); }

    /// May wait: holds the launch. Call after_launch() with the answer if it has a task or is
    /// traced.
    Grant before_launch(ThreadState& thread, const Launch& launch);
    void after_launch(ThreadState& thread, const Launch& launch, const Grant& grant,
                      bool succeeded);

    /// Whether this launch needs no asking. If so, the caller makes it at once, as
    /// thread.line.as_planned says, and tells went_as_planned() if it succeeded (as_planned.h).
    bool goes_as_planned(ThreadState& thread, const Launch& launch);
    /// Of a launch that goes as planned among others (as_planned.is_watched): whether they reckon
    /// with its task still, and then do from now on. Throws nothing.
    bool is_reckoned_with(const ThreadState& thread);

    /// Before a call that waits: what the thread launched on its stream is marked.
    void before_wait(ThreadState& thread, Wait& wait);
    /// After it; if it waited for all that the task launched, its GPU segment has ended.
    void after_wait(ThreadState& thread, const Wait& wait, bool succeeded);
    bool sleeps_through_waits() const { return cheap_waits_.are_on(); }
    /// Between the two: sleeps until that wait is (nearly) over, if the config asks for it. The
    /// program's own call still says how it ended.
    void wait_cheaply(ThreadState& thread, const Wait& wait);
    /// The thread has recorded an event on a stream: a wait for it may be one for all that was
    /// launched. Between two events that take the time (`timed`), around a single launch, comes
    /// nothing of ours.
    void event_recorded(ThreadState& thread, CUevent event, CUstream stream,
                        exec::StreamFlavor flavor, bool timed);
    /// Hints of where instances begin and end.
    Frames& frames() { return frames_; }
    /// NVTX ranges.
    Resolver& resolver() { return resolver_; }
    /// Events that streams wait for, or that are gone; streams that are gone.
    WorkOnStreams& work_on_streams() { return work_on_streams_; }
    Copies& copies() { return copies_; }

    /// Around a call that waits for all work of the context on its way (cuMemFree, say): whoever is
    /// less urgent than this thread's task launches nothing that could delay it.
    void implicit_sync_begins(ThreadState& thread);
    void implicit_sync_ended(ThreadState& thread);

    /// A graph was made executable.
    void graph_instantiated(CUgraphExec executable, CUgraph graph);

    /// Captures, priorities of streams, and streams of ours: the calls that are about these alone.
    exec::ProgramStreams& streams() { return common_.streams; }
    /// Before a launch on a stream of ours instead of the program's (exec/priority_pool.h).
    /// @returns null: it goes as it came; else streams().pool().join() is due after it
    const exec::PriorityPool::Lane* enter_pool(const Launch& launch, const Grant& grant);
    config::PriorityVia priority_via() const { return common_.scheduler.priority_via; }
    /// Before a context goes, or may go, with its streams.
    void context_ends(const exec::EndingContext& ending) {
        forget_names();
        common_.streams.context_ends();
        common_.marks.context_ends(ending);
    }
    /// After it.
    void context_ended(const exec::EndingContext& ending) {
        context_ends(ending);
        common_.streams.context_ended();
        common_.marks.context_ended(
            ending, [this](unsigned long long id) { common_.streams.pool().context_ended(id); });
    }

    /// Where the interposer notes that a launch of no chain was made, without asking.
    /// @param launched  outlives the runtime; set by any thread, cleared here
    void watch_bystanders(std::atomic<bool>& launched) {
        common_.governor.watch_bystanders(launched);
    }

    /// The thread has jumped out of a held launch, which never came to its end.
    void jumped_out_of_hold(ThreadState& thread);

    /// The thread ends: its task, if any, is free again.
    void thread_exit(ThreadState& thread);
    /// A module was unloaded: kernel handles may come to mean other kernels.
    void forget_names() {
        common_.kernels.forget();
        common_.governor.tasks().changed();
    }

    /// What graphs and unloading are told that changes nothing else.
    identity::Kernels& kernels() { return common_.kernels; }

    /// Where the GPU is.
    TaskProgress& progress() { return common_.progress; }

    Report& report() { return report_; }
    /// At the program's end: what is still to come into the trace.
    void finish_trace() { common_.tracer.finish(); }
    LiveGuard& guard() { return common_.guard; }

  private:
    // launch_path.cpp
    Grant decide_launch(ThreadState& thread, const Launch& launch);
    model::KernelEstimate estimate(TaskState& task, const Launch& launch,
                                   const model::KernelKey& key, double graph_utilization) const;
    static model::KernelEstimate unknown_kernel(const TaskState& task, const Launch& launch);
    sched::Request request_for(const TaskState& task) const;
    sched::Answer ask(TaskState& task, nanoseconds now);
    sched::Decision hold_until_admitted(TaskState& task, nanoseconds now);
    void count_wait(TaskState& task, const sched::Wait& wait, nanoseconds time);
    void hold_at_random(TaskState& task);
    int priority_for(TaskState& task, const Launch& launch, const sched::Decision& decision,
                     nanoseconds now);

    // as_planned.cpp
    void allow_as_planned(ThreadState& thread, const Launch& launch, const Grant& grant);
    static std::size_t num_unknown(nanoseconds budget);
    static bool is_at_work(const ThreadState& thread, const TaskState& task);
    static void learn_function(ThreadState& thread, const Launch& launch);
    void plan_ahead(ThreadState& thread, TaskState& task, nanoseconds now);
    std::size_t before_held(const TaskState& task, std::size_t position, std::size_t end) const;
    void go_on_as_planned(ThreadState& thread);
    Common common_;
    GpuSegments segments_;
    ImplicitSyncs syncs_;
    Runs runs_;
    Frames frames_;
    WorkOnStreams work_on_streams_;
    Resolver resolver_;
    RandomHolds random_holds_;
    const exec::CheapWaits cheap_waits_;
    Report report_;
    Copies copies_;
};

}  // namespace urgengo::runtime
