// SPDX-License-Identifier: Apache-2.0
//
// Makes copies in slices, and has them wait for those of more urgent tasks (copies.cpp says how and
// why).
#pragma once

#include <atomic>
#include <cstddef>
#include <memory>
#include <vector>

#include "host/base/clock.h"
#include "host/config/config.h"
#include "host/exec/captures.h"
#include "host/runtime/calls.h"
#include "host/runtime/live_guard.h"
#include "host/runtime/run_records.h"
#include "host/runtime/task_copies.h"
#include "host/sched/governor.h"

namespace urgengo::runtime {

/// Who knows for which task a thread copies.
class CopyingThreads {
  public:
    /// @returns the task that the thread would launch for, as far as that is known; null: none
    virtual TaskState* copying_task(ThreadState& thread) = 0;
    /// Takes the task, if its run is this thread's and no other thread is at it; release() is due
    /// then.
    virtual bool take_own(ThreadState& thread, TaskState& task) = 0;
    virtual void release(ThreadState& thread) = 0;

  protected:
    ~CopyingThreads() = default;
};

class Copies {
  public:
    /// All outlive it.
    struct Around {
        const exec::DriverApi& driver;
        Clock& clock;
        const exec::Captures& captures;
        exec::ProgressMarks& marks;
        sched::Governor& governor;
        const LiveGuard& guard;
        const std::vector<std::unique_ptr<TaskState>>& tasks;
        RunRecords& records;
    };

    /// @param may_hold  else copies are cut at most
    Copies(const config::Scheduler& scheduler, bool may_hold, const Around& around,
           CopyingThreads& threads);

    /// Whether the config asks for anything to become of copies. For good.
    bool changes_any() const { return rules_.wanted; }

    /// Before a copy: whether it is of a task, and how it is cut. before_slice() may wait; it and
    /// after_slice() belong around every slice that succeeded, or the whole copy; end() behind the
    /// last. With `task` null the copy goes as it came, and none of them is called.
    /// @threads any; each copy is its thread's
    CopyTurn begin(ThreadState& thread, const Copy& copy);
    void before_slice(ThreadState& thread, const Copy& copy, CopyTurn& turn);
    void after_slice(ThreadState& thread, const Copy& copy, CopyTurn& turn, std::size_t bytes);
    static void end(CopyTurn& turn);

    /// The thread, which has copied, has waited for something.
    static void waited_for(ThreadState& thread, const Wait& wait);

  private:
    struct Rules {
        bool wanted = false;  ///< they are held or cut, at least where there are several chains
        bool hold = false;
        std::size_t slice_bytes = 0;  ///< 0: none is cut
        nanoseconds poll{0};          ///< from one look at a slice to the next
    };

    void make_room(CopyTurn& turn);
    nanoseconds time_at_engine(const CopyTurn& turn, std::size_t bytes) const;
    CUevent record_before_copy(const Copy& copy, CopyTurn& turn);
    CUevent record_behind_copy(const Copy& copy, CopyTurn& turn, std::size_t bytes);
    CUevent event_of(TaskCopies& copies, std::size_t which) const;

    // copy_holds.cpp
    bool hold(ThreadState& thread, const CopyTurn& turn);
    bool any_copies_but(const TaskState& task, nanoseconds now) const;
    bool urgent_copies(const CopyTurn& turn, nanoseconds now);

    const Rules rules_;
    const Around around_;
    CopyingThreads& threads_;
    std::atomic<double> gbps_{sched::kSlowGbps};  ///< as slices were seen to go
};

}  // namespace urgengo::runtime
