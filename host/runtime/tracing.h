// SPDX-License-Identifier: Apache-2.0
//
// What goes into a trace. Only in programs run by `urgengo profile` and `discover`, or with
// URGENGO_TRACE set: not the launch path that counts.
//
// @threads each call is about the calling thread; what all threads share is locked or atomic
#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <string_view>
#include <vector>

#include "host/base/clock.h"
#include "host/exec/cupti_tracer.h"
#include "host/exec/kernel_timer.h"
#include "host/exec/progress_marks.h"
#include "host/identity/graphs.h"
#include "host/observe/trace_writer.h"
#include "host/runtime/calls.h"
#include "host/runtime/thread_state.h"

namespace urgengo::runtime {

/// What is written while the program runs, besides statistics.
struct TraceOptions {
    observe::TraceWriter* writer = nullptr;  ///< null: nothing
    bool time_kernels = false;               ///< with marks of their own around all launches
    exec::CuptiTracer* cupti = nullptr;      ///< times them instead
};

class Tracer {
  public:
    /// @param driver, clock, marks, graphs  outlive it
    Tracer(TraceOptions options, const exec::DriverApi& driver, Clock& clock,
           exec::ProgressMarks& marks, const identity::Graphs& graphs)
        : options_(options), driver_(driver), clock_(clock), marks_(marks), graphs_(graphs) {}

    /// @returns whether there is a trace: else only thread_ends() and finish() may be called
    bool is_on() const { return options_.writer != nullptr; }

    void launch_begins(ThreadState& thread, const Launch& launch);
    /// @param name_hash  of its kernel or graph
    /// @param task       null: of none
    void launch_ended(ThreadState& thread, const Launch& launch, std::uint64_t name_hash,
                      const TaskState* task, nanoseconds time, bool succeeded);
    void waited(ThreadState& thread, const Wait& wait, bool for_all);
    /// An instance of the task begins or ends.
    void instance(ThreadState& thread, const TaskState& task, abi::TraceKind kind, nanoseconds now,
                  int flags);
    void hint(ThreadState& thread, abi::TraceKind kind, int task, std::uint64_t token,
              nanoseconds arrival);
    /// The thread has entered a range. An empty name: it has left the innermost one.
    void range(ThreadState& thread, std::string_view name);
    void thread_ends(ThreadState& thread) { give_back_timer(thread); }
    /// At the program's end: what is still to come.
    void finish() {
        if (options_.cupti) options_.cupti->finish();
    }

    /// @returns share of the GPU that the kernel's blocks take, or the graph's kernels
    double occupied_share(const Launch& launch, const exec::MarkContext& context) const;

  private:
    void thread_name(ThreadState& thread);
    std::unique_ptr<exec::KernelTimer> take_timer(const exec::MarkContext& context);
    void give_back_timer(ThreadState& thread);
    void describe_gpu(const exec::MarkContext& context);

    const TraceOptions options_;
    const exec::DriverApi& driver_;
    Clock& clock_;
    exec::ProgressMarks& marks_;
    const identity::Graphs& graphs_;
    std::atomic<bool> gpu_described_{false};
    std::mutex timers_mutex_;
    std::vector<std::unique_ptr<exec::KernelTimer>> idle_timers_;
    int num_timers_ = 0;
};

}  // namespace urgengo::runtime
