// SPDX-License-Identifier: Apache-2.0
//
// The one class that the interposer calls. It follows the program's instances, tells every launch
// whether and at which priority it may go, holds it if not, and keeps the progress marks coming.
//
// Threads: every function is called in the program's threads. The launch path takes no lock and
// allocates nothing; hints (a few a frame) take a mutex. Decisions are pure code in host/sched.
//
// Rules that keep a hold harmless (host/README.md): it ends by GPU progress or by time;
// only launches are held; what holds may add to one instance is bounded; switching the runtime off
// ends every hold within one poll.
#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "host/base/clock.h"
#include "host/config/resolved_config.h"
#include "host/exec/captures.h"
#include "host/exec/progress_marks.h"
#include "host/runtime/task.h"

namespace urgengo::runtime {

/// A launch as the program asked for it.
struct Launch {
    CUfunction function = nullptr;  ///< null: a graph
    std::uint64_t grid_blocks = 1;
    std::uint32_t block_threads = 1;
    CUstream stream = nullptr;
    exec::StreamFlavor flavor = exec::StreamFlavor::kLegacy;
    bool depends_on_previous = false;  ///< programmatically: nothing may come between
};

/// What before_launch() grants.
struct Grant {
    TaskState* task = nullptr;  ///< null: of no chain, forward untouched
    bool scheduled = false;     ///< else the launch is only counted
    bool set_priority = false;
    int priority = 0;
    nanoseconds estimate{0};
};

class Runtime {
  public:
    /// @param driver, clock  outlive the runtime
    Runtime(config::ResolvedConfig resolved, const exec::DriverApi& driver, Clock& clock);

    /// Off: nothing is held or changed any more, for good or until switched on again. Any thread.
    void set_mode(config::Mode mode) { mode_.store(mode, std::memory_order_relaxed); }
    config::Mode mode() const { return mode_.load(std::memory_order_relaxed); }

    /// May wait: holds the launch. Call after_launch() with the answer.
    Grant before_launch(ThreadState& thread, const Launch& launch);
    void after_launch(ThreadState& thread, const Launch& launch, const Grant& grant,
                      bool succeeded);

    /// Before a call that waits for `stream`: what the thread launched there is marked.
    void before_wait(ThreadState& thread, CUstream stream, exec::StreamFlavor flavor);
    /// After a call that waited for the GPU; if for all that the task launched, its GPU segment has
    /// ended.
    void after_wait(ThreadState& thread, bool for_task);
    /// @returns whether a wait for `stream` waits for everything that the thread's task launched
    static bool waits_for_task(const ThreadState& thread, CUstream stream,
                               exec::StreamFlavor flavor);

    /// A capture of some stream begins, or has ended (with whatever result ends one).
    void capture_begins() { captures_.began(); }
    void capture_ended() { captures_.ended(); }

    /// The thread ends: its task, if any, is free again.
    void thread_exit(ThreadState& thread);
    /// A module was unloaded: kernel handles may come to mean other kernels.
    void forget_names() { names_epoch_.fetch_add(1, std::memory_order_relaxed); }

    // Hints; see include/urgengo/urgengo.h.
    std::uint64_t arrival(const char* chain, nanoseconds when);
    bool task_begin(ThreadState& thread, std::uint64_t instance, const char* task);  ///< exit?
    void task_end(ThreadState& thread);

    /// Frames that never came to their end count as missed once their deadline has passed.
    std::vector<const ChainStatistics*> statistics();

  private:
    static constexpr std::size_t kMaxInstances = 256;

    TaskState* resolve(ThreadState& thread);
    TaskState* match_thread_name(ThreadState& thread);
    bool begin_run(ThreadState& thread, TaskState& task, nanoseconds arrival);
    void end_run(TaskState& task);
    void leave_task(ThreadState& thread);
    TaskState* begin_named_run(ThreadState& thread);
    void end_named_run(ThreadState& thread, nanoseconds now);
    void forget_instance(std::uint64_t token);
    void finish_instance(ChainState& chain, nanoseconds arrival, nanoseconds now);
    bool enter_gpu_segment(TaskState& task);
    /// @param idle  whether all that the task launched is known to have executed
    void leave_gpu_segment(TaskState& task, bool idle);
    model::KernelEstimate estimate(ThreadState& thread, const TaskState& task,
                                   const Launch& launch);
    void emit_mark(TaskState& task);
    /// What one look at everybody's progress says about the launch at hand.
    struct Look {
        int rank = 0;
        bool admitted = true;          ///< by the admission
        bool within_run_ahead = true;  ///< else the launch is paced: the GPU has enough of the task
    };
    Look look(TaskState& task);
    int hold_until_admitted(TaskState& task);  ///< @returns the rank
    bool schedules() const;

    const config::Scheduler scheduler_;
    const exec::DriverApi& driver_;
    Clock& clock_;
    std::atomic<config::Mode> mode_;
    std::atomic<std::uint32_t> names_epoch_{1};
    std::atomic<CUdevice> device_{-1};  ///< the one whose work is scheduled: the first seen
    exec::Captures captures_;
    exec::ProgressMarks marks_;
    std::unique_ptr<abi::SharedPage> page_;
    std::vector<std::unique_ptr<ChainState>> chains_;
    std::vector<std::unique_ptr<TaskState>> tasks_;  // shape [page_->num_tasks]

    std::mutex instances_mutex_;
    std::array<Instance, kMaxInstances> instances_;
    std::uint64_t next_token_ = 1;
};

}  // namespace urgengo::runtime
