// SPDX-License-Identifier: Apache-2.0
//
// What the interposer keeps for each thread of the program; touched by that thread only.
#pragma once

#include <array>
#include <memory>

#include "host/exec/kernel_timer.h"
#include "host/identity/kernel_cache.h"
#include "host/identity/served_chains.h"
#include "host/observe/trace_writer.h"
#include "host/runtime/task.h"
#include "host/runtime/thread_line.h"

namespace urgengo::runtime {

struct alignas(64) ThreadState {
    ThreadState() : ThreadState(own_line) {}
    /// @param line  stays for as long as this object
    explicit ThreadState(ThreadLine& its) : line(its) {}
    ThreadState(const ThreadState&) = delete;
    ThreadState& operator=(const ThreadState&) = delete;

    ThreadLine& line;
    std::uint16_t patience = 1;  ///< waits to pass the next time: grows while the name stays

    TaskState* task = nullptr;     ///< whose run this thread has begun; null: none
    TaskState* at_task = nullptr;  ///< whose `busy` this thread has set
    bool hinted = false;           ///< between task_begin and task_end
    bool uses_hints = false;       ///< ever hinted: its name does not count any more
    bool ranged = false;           ///< the run in progress is an NVTX range
    bool last_task = false;        ///< the hinted task is its chain's last
    bool name_is_fresh = false;    ///< the thread's name was read since its last wait
    bool name_was_read = false;    ///< ever
    Instance instance;             ///< that the task belongs to, if hinted
    identity::ServedChains chains_served;
    char name[16] = {};
    /// Tasks that a thread of this name may work for, in the config's order.
    std::array<TaskState*, abi::kMaxTasks> candidates{};
    int num_candidates = 0;
    TaskState* last_named = nullptr;  ///< the last of them that ran here

    // At the end of the last wait, for the arrival of what begins next:
    nanoseconds wait_end{0};  ///< 0: none yet
    std::uint32_t wait_end_cpu_us = 0;

    bool measuring = false;  ///< has recorded a timing event and launched nothing since

    /// The last events recorded on that stream, and the launches before each: a wait for one may be
    /// a wait for all.
    struct RecordedEvent {
        CUevent event = nullptr;
        std::uint32_t launches = 0;
    };
    std::array<RecordedEvent, 4> events{};

    /// What the wait at hand is for, of a task over several streams; null: of none.
    struct WaitedFor {
        TaskState* task = nullptr;
        bool is_last = false;  ///< of the thread's launches, by their stream alone
        progress::Coverage covered;
    } waited_for;

    /// A task whose work it has had a stream wait for, since its own last run; null: none.
    TaskState* lends_to = nullptr;
    nanoseconds lends_until{0};  ///< the GPU time of that work, and what was before

    /// A kernel or graph that this thread has launched, by its handle.
    struct CachedKernel {
        const void* function = nullptr;  ///< or executable graph
        std::uint64_t name_hash = 0;
        float utilization = 1;  ///< of a graph
        bool is_new = false;    ///< never launched, as far as is known
        /// Tasks with a `kernels:` pattern for its name; null: none.
        const model::TaskSet* begins = nullptr;
    };
    identity::KernelCache<CachedKernel> kernels;  ///< emptied when any module is unloaded
    std::uint32_t names_epoch = 0;

    CopyOfThread copied;

    // Tracing:
    observe::TraceCursor trace;
    std::unique_ptr<exec::KernelTimer> timer;
    bool untimed = false;  ///< a timer was refused
    char traced_name[16] = {};
    std::array<std::uint64_t, 64> traced_ranges{};  ///< hashes whose text is in the trace
    std::uint32_t launches_at_wait = 0;             ///< `launches` at the last wait

    ThreadLine own_line;  ///< where nobody keeps another one
};

}  // namespace urgengo::runtime
