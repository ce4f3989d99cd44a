// SPDX-License-Identifier: Apache-2.0
//
// Who opens gates (gates.h), on the host: a thread of ours, and whatever thread of the program has
// just changed what decides; and when none may be closed. Where the GPU opens gates, our thread
// looks more seldom: for what no mark tells of, time above all, and for bounds.
//
// @threads any; takes no lock
#pragma once

#include <atomic>
#include <memory>
#include <string>

#include "host/base/clock.h"
#include "host/base/thread_nice.h"
#include "host/config/dispatch_choice.h"
#include "host/exec/dispatcher.h"
#include "host/exec/poller.h"
#include "host/observe/nvtx_out.h"
#include "host/runtime/gate_events.h"
#include "host/runtime/roster.h"
#include "host/runtime/run_records.h"
#include "host/runtime/task_progress.h"
#include "host/sched/core_load.h"
#include "host/sched/dispatch_round.h"
#include "host/sched/governor.h"

namespace urgengo::runtime {

class GateKeeper {
  public:
    /// All outlive it.
    struct Around {
        const exec::DriverApi& driver;
        Clock& clock;
        abi::SharedPage& page;
        sched::Governor& governor;
        TaskProgress& progress;
        const Roster& roster;
        RunRecords& records;
        observe::NvtxOut* nvtx = nullptr;  ///< null: nothing is told
        ThreadNice* nice = nullptr;        ///< which its threads take, as those of chains do
    };
    /// @param scheduler  outlives it
    GateKeeper(const config::Scheduler& scheduler, const config::Serialised& serialised,
               const Around& around);

    /// @returns what is to be said when UrgenGo starts; empty: nothing
    std::string note() const;

    /// Gates may be closed at all.
    bool are_on() const { return opens_by_ != config::Dispatch::kThread; }
    bool are_opened_by_gpu() const { return are_on() && opens_by_ != config::Dispatch::kHost; }
    /// Launches that have to wait go behind gates now, rather than sleep in their threads.
    bool are_wanted() const { return opens_by_ != config::Dispatch::kAuto || cores_.are_busy(); }
    /// A thread has slept for its turn.
    void slept(nanoseconds asked, nanoseconds took, nanoseconds now) {
        cores_.slept(asked, took, now);
    }
    const sched::CoreLoad& cores() const { return cores_; }
    bool is_parked() const { return around_.page.dispatch.parked.load() != 0; }
    exec::Dispatcher& dispatcher() { return dispatcher_; }

    /// A task is about to close gates, the first of some. @returns false: it must not
    bool begins();
    /// All of its gates are open, or are opened now. By the thread that has taken it.
    void ends(TaskState& task, nanoseconds now);
    /// The same of one whose GPU segment has ended; others may go now.
    void segment_ended(TaskState& task, nanoseconds now);

    /// Instead of threads of ours, before there is one. @param leases  null: a thread of ours
    void look_by(exec::Poller& opens, exec::Poller* leases = nullptr) {
        if (!threads_.are_made.exchange(true)) start(opens, leases);
    }

    /// Something has changed that no mark tells of: what may go, goes.
    void changed();
    /// A gate was closed: it is looked after from now on.
    void closed();
    void publish_clock(nanoseconds now);
    /// Before a call that waits for all GPU work: all gates open, and none is closed before
    /// unpark().
    void park();
    void unpark();
    /// A kernel is about to be launched. Where its blocks take more than half of a multiprocessor's
    /// shared memory, or it fills_gpu(), a resident dispatcher leaves the GPU until the kernel
    /// should have executed, and the host opens gates.
    /// @param threads  of the grid
    /// @param until    that time, as far as is known
    void find_room(std::uint32_t shared_bytes, std::uint64_t threads, nanoseconds until) {
        if (is_leased() && (fills_gpu(threads) || dispatcher_.has_no_room_for(shared_bytes)))
            dispatcher_.leave_until(until + kRoomAfter);
    }
    /// @returns whether so many threads of a grid leave a resident dispatcher no thread slot, and
    ///          that matters: beside it such a kernel takes up to 11 % longer (H200), others 5 % at
    ///          most. `auto` gives way then; who asks for a resident one by name has it.
    bool fills_gpu(std::uint64_t threads) const {
        return threads >= full_from_.load(std::memory_order_relaxed);
    }
    /// @param thread_slots  threads that the GPU holds at once
    void knows_gpu(double thread_slots) {
        if (opens_by_ != config::Dispatch::kAuto || !is_leased()) return;
        const auto from = static_cast<std::uint64_t>(thread_slots);
        if (!fills_gpu(from)) full_from_.store(from, std::memory_order_relaxed);
    }
    /// One stays on the GPU while gates are closed.
    bool is_leased() const {
        return are_opened_by_gpu() && scheduler_.dispatch.device == config::DeviceDispatch::kLeased;
    }
    /// A grid is about to be launched whose blocks must all be on the GPU at once.
    void whole_gpu_is_needed() {
        if (are_on()) dispatcher_.whole_gpu_is_needed();
    }

    /// Nothing is held any more: what is closed opens. A thread that closes one from here on sees
    /// to it that it is looked at.
    void holds_end() {
        if (are_on()) open_all(around_.clock.now());
    }
    /// The same of some chains' tasks (GovernedChain::may_act).
    void holds_of_chains_end();

    /// UrgenGo has switched itself off: no gate is closed any more, and the GPU opens none.
    void trip();
    /// Before and after a context goes, or may go.
    void context_ends(const exec::EndingContext& ending) { dispatcher_.context_ends(ending); }
    void context_ended(const exec::EndingContext& ending) { dispatcher_.context_ended(ending); }

    observe::GateStatistics counts() const;

  private:
    /// For what is before such a kernel on its stream; also the least time between two residencies.
    static constexpr nanoseconds kRoomAfter{5'000'000};

    void start(exec::Poller& opens, exec::Poller* leases);
    exec::More extend();
    void stop();
    exec::More look();
    exec::More look_once(nanoseconds now);
    void take_nice(ThreadNice::Seen& seen);
    /// The GPU may go by it that the host looks after gates.
    void beat(nanoseconds now);
    bool are_opened_by_host_alone() const {
        return opens_by_ == config::Dispatch::kHost ||
               (is_leased() && (!dispatcher_.may_reside() || dispatcher_.is_left()));
    }
    int run_round(nanoseconds now);
    std::uint32_t open_all(nanoseconds now);
    void open_overdue(nanoseconds now);
    bool may_be_closed_again(nanoseconds now) const;

    const config::Scheduler& scheduler_;
    const Around around_;
    const config::DispatchChoice choice_;
    const config::Dispatch opens_by_ = choice_.where;
    const int most_gated_;
    sched::HostRounds rounds_;
    GateEvents events_;
    sched::CoreLoad cores_;
    exec::Dispatcher dispatcher_;
    struct Threads {  // run until the process ends
        std::atomic<exec::Poller*> opens{nullptr}, leases{nullptr};
        std::atomic<bool> are_made{false};
    } threads_;
    struct OfThread {
        nanoseconds looked_at{0};     // when its last look ended, and
        exec::More rests{};           // how it rests since
        nanoseconds scheduled_at{0};  // when it last found that launches are scheduled
        ThreadNice::Seen nice = 0;
    } of_thread_;
    ThreadNice::Seen nice_of_leases_ = 0;         // of the thread that extends them
    std::atomic<std::int64_t> chains_end_ns_{0};  // when holds of chains last had to end
    std::atomic<std::uint64_t> full_from_{~std::uint64_t{0}};  // threads; at first none are so many
    std::atomic<int> gated_{0};                                // tasks that may have closed gates
    std::atomic<std::uint64_t> closed_{0}, refused_{0}, past_bound_{0};
    std::atomic<std::int64_t> most_past_ns_{0};
};

}  // namespace urgengo::runtime
