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

#include "host/base/clock.h"
#include "host/exec/dispatcher.h"
#include "host/exec/poller.h"
#include "host/runtime/roster.h"
#include "host/runtime/task_progress.h"
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
    };
    /// @param scheduler  outlives it
    GateKeeper(const config::Scheduler& scheduler, bool launches_block, const Around& around);

    bool are_on() const { return opens_by_ != config::Dispatch::kThread; }
    bool are_opened_by_gpu() const { return are_on() && opens_by_ != config::Dispatch::kHost; }
    bool is_parked() const { return around_.page.dispatch.parked.load() != 0; }
    exec::Dispatcher& dispatcher() { return dispatcher_; }

    /// A task is about to close gates, the first of some. @returns false: it must not
    bool begins();
    /// All of its gates are open, or are opened now. By whoever has the task.
    void ends(TaskState& task, nanoseconds now);
    /// The same of one whose GPU segment has ended; others may go now.
    void segment_ended(TaskState& task, nanoseconds now);

    /// Instead of a thread of ours, before there is one.
    void look_by(exec::Poller& poller) {
        if (!thread_is_made_.exchange(true)) start(poller);
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
    /// A grid is about to be launched whose blocks must all be on the GPU at once.
    void whole_gpu_is_needed() {
        if (are_on()) dispatcher_.never_again();
    }

    observe::GateStatistics counts() const;

  private:
    void start(exec::Poller& poller);
    exec::More look();
    int run_round(nanoseconds now);
    void open_all(nanoseconds now);
    void open_overdue(nanoseconds now);

    const config::Scheduler& scheduler_;
    const Around around_;
    const config::Dispatch opens_by_;
    const int most_gated_;
    sched::HostRounds rounds_;
    exec::Dispatcher dispatcher_;
    std::atomic<exec::Poller*> thread_{nullptr};  // runs until the process ends
    std::atomic<exec::Poller*> lease_thread_{nullptr};
    std::atomic<bool> thread_is_made_{false};
    std::atomic<int> gated_{0};  // tasks that may have closed gates
    std::atomic<std::uint64_t> closed_{0}, parks_{0}, refused_{0};
};

}  // namespace urgengo::runtime
