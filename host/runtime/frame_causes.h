// SPDX-License-Identifier: Apache-2.0
//
// Why frames are late, live: gathers what is noted of a frame's runs through the tasks of its
// chain, and, where the frame was late, what its tasks and others did on the GPU meanwhile, from
// what marks left (task_pieces.h). Which of it is the cause is decided in observe/lost_time.h and
// miss_cause.h.
//
// A CPU segment that took longer is one in which its thread computed, or waited for a core; or
// slept, for a lock, I/O or another thread. That is told by what the kernel counts for the thread:
// asked once when the program's wait has ended or a task begins (one system call, 0.35 us on a
// 2-core machine, and only of a task that has a profile), and again where a segment is longer by
// half a millisecond than it should be: never by a launch that comes in time.
//
// A run is compared with the profile, where there is one: CPU segments, launch times, and the work
// on the GPU by the estimates of what was launched. Without one, and for what no profile tells (how
// long after its arrival a frame begins, what is computed behind the last wait), with what is usual
// for the task.
//
// @threads what is told of a task: the thread that has it. Ends of runs and frames take a mutex, a
//          few times a frame, in which nothing is allocated, and no other task is looked at
#pragma once

#include <array>
#include <atomic>
#include <mutex>
#include <string>
#include <vector>

#include "host/base/clock.h"
#include "host/runtime/roster.h"
#include "host/sched/governor.h"

namespace urgengo::runtime {

class FrameCauses {
  public:
    /// @param all of them  outlive it
    FrameCauses(const Roster& roster, const sched::Governor& governor, Clock& clock)
        : roster_(roster), governor_(governor), clock_(clock) {}
    /// Once the roster is there, before anything is told.
    void take_roster();

    // --- told of the run under way
    void run_begins(TaskState& task, nanoseconds now) const;
    /// A CPU segment of the calling thread begins: its wait has ended, or its task begins.
    void cpu_segment_begins(TaskState& task, nanoseconds now) const;
    /// It took so long; before the estimates hear of it.
    void cpu_segment_ended(TaskState& task, nanoseconds took, nanoseconds now) const;
    static void segment_begins(TaskState& task, nanoseconds now);
    /// @param idle  by a wait for all of its work
    void segment_ended(TaskState& task, bool idle, nanoseconds now) const;
    /// A launch of the task was held behind another task's.
    void held(TaskState& task, int behind, nanoseconds time, nanoseconds now) const;
    /// It waits for work of another task on the GPU.
    static void waits_for(TaskState& task, const TaskState& other);
    void run_ends(TaskState& task, nanoseconds now);

    // --- asked
    /// The frame has come to its end: why it is late, if it is. Counted.
    /// @param exited  its program was told to end it early, as it lacked so much time
    observe::Cause frame_ended(const ChainState& chain, nanoseconds arrival, nanoseconds now,
                               std::optional<nanoseconds> exited = std::nullopt);
    /// A frame of it never came to its end. @threads any; takes no lock
    void dropped(const ChainState& chain) { count(chain, {observe::MissCause::kDropped}); }
    /// @returns what was counted of the chain. @threads any; takes no lock
    std::vector<observe::CauseCount> counts(const ChainState& chain) const;

  private:
    static constexpr std::size_t kFrames = 16;  ///< of a chain, that are under way at a time

    struct Frame {
        nanoseconds arrival{0};
        bool is_known = false;
        nanoseconds last_end{0};  ///< of the run of the task before
        int waits_for = -1;       ///< chain on whose work its streams waited; -1: none
        /// Of all its segments and holds, of which the rings of its tasks have the last.
        std::uint32_t num_segments = 0;
        nanoseconds gpu_beyond{0}, held{0};
        observe::FrameFacts facts;
    };
    struct Chain {
        std::array<Frame, kFrames> frames;
        std::size_t next = 0;  ///< is forgotten, if there is no room
        /// By cause, then by chain behind, -1 first. Not under mutex_.
        std::vector<std::atomic<std::uint64_t>> counted;
    };

    /// What is decided of its run is done.
    bool is_acted_on(const TaskState& task) const {
        return governor_.acts() && !task.run.observed && !task.run.only_decides;
    }
    void note_given_up(TaskState& task, nanoseconds now) const;
    static void add_cpu(RunFacts& facts, nanoseconds longer, nanoseconds slept);
    nanoseconds slept_since(const SegmentUse& begin, nanoseconds longer, nanoseconds now) const;
    Frame& find(Chain& chain, nanoseconds arrival);
    Frame take_out(const ChainState& chain, nanoseconds arrival);
    /// Adds what it lost on the GPU, and to whom. Allocates.
    void add_lost_time(const ChainState& chain, Frame& frame, nanoseconds now) const;
    observe::FramesWork work_of(const ChainState& chain, const Frame& frame, nanoseconds now) const;
    /// Since `begin`.
    std::vector<observe::OthersSegment> others_of(const ChainState& chain, nanoseconds begin,
                                                  nanoseconds now) const;
    void count(const ChainState& chain, const observe::Cause& cause);

    const Roster& roster_;
    const sched::Governor& governor_;
    Clock& clock_;
    std::mutex mutex_;
    std::vector<Chain> chains_;  ///< under mutex_, if nothing else is said
};

}  // namespace urgengo::runtime
