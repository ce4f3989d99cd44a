// SPDX-License-Identifier: Apache-2.0
//
// What the interposer keeps for each thread of the program; touched by that thread only.
#pragma once

#include <array>
#include <memory>

#include "host/base/thread_nice.h"
#include "host/exec/kernel_timer.h"
#include "host/identity/kernels.h"
#include "host/identity/last_wait.h"
#include "host/identity/served_chains.h"
#include "host/identity/task_names.h"
#include "host/observe/trace_writer.h"
#include "host/runtime/task.h"
#include "host/runtime/thread_line.h"

namespace urgengo::runtime {

/// Whose launches a thread makes, as far as is known (resolver.h, frames.h).
struct ThreadServes {
    bool hinted = false;         ///< between task_begin and task_end
    bool uses_hints = false;     ///< ever hinted: its name does not count any more
    bool ranged = false;         ///< the run in progress is an NVTX range
    bool last_task = false;      ///< the hinted task is its chain's last
    bool name_is_fresh = false;  ///< the thread's name was read since its last wait
    Instance instance;           ///< that the task belongs to, if hinted
    identity::NamedThread named;
    identity::ServedChains chains;
};

/// What a thread waits for, or has a stream wait for (waits.cpp, work_on_streams.h).
struct ThreadWaits {
    identity::LastWait last_wait;  ///< for the arrival of what begins next

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
};

/// What a thread has in the trace (tracing.cpp).
struct ThreadTracing {
    observe::TraceCursor cursor;
    std::unique_ptr<exec::KernelTimer> timer;
    bool untimed = false;  ///< a timer was refused
    char name[16] = {};
    std::array<std::uint64_t, 64> ranges{};  ///< hashes whose text is in the trace
    std::uint32_t launches_at_wait = 0;      ///< `launches` at the last wait
};

struct alignas(64) ThreadState {
    ThreadState() : ThreadState(own_line, 0) {}
    /// @param line    stays for as long as this object
    /// @param thread  gettid; 0: not known
    ThreadState(ThreadLine& its, int thread) : line(its), id(thread) {}
    ThreadState(const ThreadState&) = delete;
    ThreadState& operator=(const ThreadState&) = delete;

    ThreadLine& line;
    const int id;                  ///< gettid; 0: not known
    TaskState* task = nullptr;     ///< whose run this thread has begun; null: none
    TaskState* at_task = nullptr;  ///< whose `busy` this thread has set
    ThreadServes serves;
    bool measuring = false;  ///< has recorded a timing event and launched nothing since
    ThreadWaits waits;
    identity::KernelsOfThread kernels;  ///< emptied when any module is unloaded
    CopyOfThread copied;
    ThreadTracing tracing;
    ThreadNice::Seen nice = 0;
    ThreadLine own_line;  ///< where the interposer keeps no other one
};

}  // namespace urgengo::runtime
