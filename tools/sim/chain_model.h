// SPDX-License-Identifier: Apache-2.0
//
// The thread of a chain, as urgengo-chains runs it: it sleeps until a frame arrives, then for each
// task computes, launches all kernels on its stream and waits for them.
//
//            +--------------------------- frame done ----------------------+
//            v                                                            |
//   kAsleep --arrival--> kComputing --> (asks) --goes--> kLaunching --all launched--> kWaiting
//                            ^           |  ^---- look again ---+  |                   |
//                            |           +--waits--> kHeld -----+  +--next kernel--> (asks)
//                            +------------------------ next task ----------------------+
//
// (With a lock: kLocked between kComputing and the first question, while another thread has it.
// Where a launch takes its thread more than the driver does, kStepping before the question.)
#pragma once

#include <algorithm>
#include <vector>

#include "tools/chains/arrivals.h"
#include "tools/chains/report.h"
#include "tools/chains/workload.h"
#include "tools/sim/gpu_model.h"
#include "tools/sim/subject.h"

namespace urgengo::sim {

/// What a thread needs of the world: afterwards its go_on() is called.
class ChainSurroundings {
  public:
    virtual ~ChainSurroundings() = default;
    /// Takes so much time on a core.
    virtual void compute(int thread, nanoseconds work) = 0;
    /// The same, to launch.
    virtual void compute_launch(int thread, nanoseconds work) = 0;
    /// @param is_late  as a sleeping thread is
    virtual void wake_at(int thread, nanoseconds when, bool is_late) = 0;
    /// On one of the thread's streams, at once.
    virtual void launch(int thread, int branch, const KernelWork& work) = 0;
    /// What comes next on `branch` waits for all that is on `other` by now.
    virtual void join(int thread, int branch, int other) = 0;
    /// @returns whether it has the lock now; else it goes on when it has
    virtual bool take(int thread, int lock) = 0;
    virtual void release(int lock) = 0;
    /// Spins until this mark on a stream of its has ended.
    virtual void wait_for_mark(int thread, std::int64_t tag) = 0;
    /// For all that is on the thread's first stream. @returns whether it was over already
    virtual bool wait(int thread) = 0;
    virtual const GpuShape& gpu_shape() const = 0;
};

/// What a launch takes of its thread, in the driver. @source urgengo bench launches, H200
inline constexpr nanoseconds kLaunch{2'300};

/// Of a launch that is not made in a loop, or not on the thread's first stream.
struct LaunchTraits {
    nanoseconds step{0};  ///< of its thread, from the launch before; at least ChainTraits::launch
    int branch = 0;       ///< the stream that it is on; 0: the thread's first
    std::vector<int> after{};  ///< streams that its own waits for first: all that is on them so far
};

/// The launches of a task, in their order.
struct TaskTraits {
    std::vector<LaunchTraits> launches{};  ///< of the last ones none need be given
    std::vector<int> joins{};              ///< streams that the first one waits for in the end
};

/// What a program does that its workload does not say.
struct ChainTraits {
    nanoseconds launch = kLaunch;  ///< what a launch takes of its thread
    int lock = kNoLock;            ///< under which a task launches
    bool never_ends = false;       ///< its GPU work waits for what never comes
    /// Of more frames that have come and wait, the oldest are left out; 0: of none.
    std::size_t most_waiting = 0;
    std::vector<TaskTraits> tasks{};  ///< of the last ones none need be given

    static constexpr int kNoLock = -1;
    /// @returns how many streams its thread has
    int num_branches() const;
};

class ChainModel {
  public:
    /// @param thread  by which the surroundings know it; also the chain's index
    ChainModel(const chains::Chain& chain, int thread, std::vector<chains::PlannedFrame> frames,
               nanoseconds deadline, const ChainTraits& traits, ChainSurroundings& surroundings,
               Subject& subject);

    /// At the run's start, and whenever what it waited for has come.
    void go_on(nanoseconds now);
    bool is_done() const { return frame_ == frames_.size(); }
    const std::vector<chains::InstanceRecord>& records() const { return records_; }

  private:
    enum class State {
        kBegin,
        kAsleep,
        kComputing,
        kLocked,
        kStepping,
        kHeld,
        kLaunching,
        kWaiting
    };

    void next_frame(nanoseconds now);
    void begin_task(nanoseconds now);
    void computed(nanoseconds now);
    void next_launch(nanoseconds now);
    void join(int branch, int other, nanoseconds now);
    void ask(nanoseconds now);
    void launched(nanoseconds now);
    void task_done(nanoseconds now);
    void end_frame(chains::Outcome outcome, nanoseconds now);
    const LaunchTraits& launch_traits() const;
    const std::vector<int>& joins() const;
    /// @returns what comes before a launch's call, since the one before
    nanoseconds step() const {
        return std::max(launch_traits().step - traits_.launch, nanoseconds{0});
    }
    std::size_t num_arrived(nanoseconds now) const;
    const chains::Task& task() const { return chain_.tasks[static_cast<std::size_t>(at_.task)]; }

    const chains::Chain& chain_;
    const int thread_;
    const std::vector<chains::PlannedFrame> frames_;
    const nanoseconds deadline_;
    const ChainTraits traits_;
    ChainSurroundings& surroundings_;
    Subject& subject_;
    std::vector<std::vector<KernelWork>> works_;  ///< by task, of inputs of the middle size
    State state_ = State::kBegin;
    std::size_t frame_ = 0;
    Place at_;
    LaunchAnswer answer_;
    std::vector<chains::InstanceRecord> records_;
};

}  // namespace urgengo::sim
