// SPDX-License-Identifier: Apache-2.0
//
// The dispatcher on the GPU, as the host needs it: its kernels and memory in the context whose work
// is scheduled, gates in streams, and what is launched ahead: the resident kernel's leases, or arms
// (arms.h), which take their place in an armed dispatcher.
//
// A gate is a wait of a stream for a word of the active kernel buffer (cuStreamWaitValue32), which
// lies in the host's memory: so the host opens it by a store, whatever the driver is doing, and the
// GPU by a store over the bus. Opened by the GPU the stream goes on 11.7 us later, by the host 6.5
// (measured, H200; from the GPU's own memory it would be 7.6).
//
// One context at a time has a dispatcher: the first that is scheduled.
#pragma once

#include <atomic>
#include <mutex>

#include "host/config/config.h"
#include "host/exec/arms.h"
#include "host/exec/driver_api.h"
#include "host/exec/event_marks.h"
#include "urgengo/abi/dispatcher.h"

namespace urgengo::exec {

struct MarkContext;

/// Never destroyed, and never changes once it is known.
struct DispatchContext {
    unsigned long long id = 0;
    CUcontext handle = nullptr;
    CUdevice device = -1;
    CUfunction mark = nullptr, lease = nullptr;  ///< the latter is of an arm, too
    int shared_bytes_of_sm = 0;
    bool overlaps = false;      ///< its marks wait for a kernel before them that overlaps them
    CUstream stream = nullptr;  ///< of ours, at the greatest priority
    CUdeviceptr d_page = 0;     ///< the active kernel buffer, as the GPU sees it
    abi::DispatchArgs args{};
    abi::DispatchLease* lease_page = nullptr;
};

class Dispatcher {
  public:
    /// @param page, driver  outlive it
    Dispatcher(const DriverApi& driver, abi::SharedPage& page,
               const config::DispatchSettings& settings, std::size_t num_tasks)
        : driver_(driver), page_(page), settings_(settings), num_tasks_(num_tasks) {}

    /// Makes gates possible in the calling thread's current context.
    /// @returns null if it gets none: the driver refused, which it is not asked again after; it
    ///          ends meanwhile; or another context has them
    /// @threads any; takes a lock and allocates at its first call
    const DispatchContext* prepare(const MarkContext& marks);

    /// Puts a closed gate of the task behind what is on the stream.
    /// @threads the one that has taken the task, in that context
    CUresult close(const DispatchContext& context, int task, std::uint32_t gate, CUstream stream,
                   StreamFlavor flavor) const;

    /// A progress mark that opens gates, too, or tells who does, and which gate is behind it.
    CUresult launch_mark(const DispatchContext& context, CUdeviceptr d_line, const Mark& mark,
                         int priority, bool overlaps) const;

    /// Of a leased dispatcher: it is resident for another lease after those that have not ended,
    /// unless kLeasesAhead have not. Of an armed one: so many arms wait. Does nothing while another
    /// thread does it.
    /// @threads any that may wait for the driver, in that context
    void extend_lease(nanoseconds lease, nanoseconds now);
    /// The same in that context, which becomes the calling thread's, and as many arms as are of
    /// use.
    /// @returns false: there is none any more
    /// @threads our own
    bool extend_lease_from_outside(nanoseconds lease, nanoseconds now);
    /// It ends as soon as it can, and comes back when it is extended after that time: what is
    /// launched meanwhile has no room beside it. @threads any
    void leave_until(nanoseconds time);
    /// @param shared_bytes  of a block
    /// @returns whether the multiprocessor that has a resident kernel may have no room for it
    bool has_no_room_for(std::uint32_t shared_bytes) const {
        const DispatchContext* const context = known_.load(std::memory_order_acquire);
        return context && 2 * std::int64_t{shared_bytes} > context->shared_bytes_of_sm;
    }
    /// @returns whether the GPU may have one, now or later
    bool may_reside() const { return may_reside_.load(std::memory_order_relaxed); }
    /// @returns whether it has left the GPU to a kernel, or is about to (leave_until)
    bool is_left() const { return away_until_ns_.load(std::memory_order_relaxed) != 0; }
    /// How often a lease found the host silent, and opened all gates.
    std::uint32_t forsaken() const;
    /// It ends as soon as it can, and does not come back before go_on(). No thread is launching one
    /// any more, nor in that context for it, or it takes long for that. No arm waits. @threads any
    void end_lease();
    /// @returns whether all leases have ended, or all arms
    bool has_ended() const;
    /// No arm waits in vain for longer than a lease. Calls nothing of the driver's.
    /// @returns whether to look again soon  @threads one at a time
    bool look_at_arms(nanoseconds now, nanoseconds lease);
    /// Unless something is parked, perhaps by another thread meanwhile.
    void go_on();
    /// The same for good. @threads any
    void never_again();
    /// A grid is about to be launched whose blocks must all be there at once. It waits for every
    /// block that is there before it, and must not find a resident one again and again: leases end
    /// for good. Arms go on: one that waits has no block, one that was woken is as short as marks.
    void whole_gpu_is_needed() {
        if (!is_armed()) never_again();
    }
    /// Before and after a context goes, or may go.
    void context_ends(const EndingContext& ending);
    void context_ended(const EndingContext& ending);

  private:
    /// So that the next one begins when one ends, whenever the host has its turn.
    static constexpr std::uint32_t kLeasesAhead = 3;
    /// That a lease stood still: for one there may be another reason (a debugger, say).
    static constexpr std::uint32_t kMostGaps = 3;

    bool is_armed() const { return settings_.device == config::DeviceDispatch::kArmed; }
    bool make_current() const;
    bool may_launch() const { return may_reside_.load() && !may_end_.load(); }
    void launch_leases(nanoseconds lease, nanoseconds now, bool from_outside);
    bool is_away(nanoseconds now);
    bool is_time_sliced(const abi::DispatchLease& page);
    bool launch_lease(const DispatchContext& context, nanoseconds lease);
    void tick_arms(const DispatchContext& context) {
        if (is_armed()) arms_.tick_through(*context.lease_page, leases_.load());
    }
    bool set_up(DispatchContext& context, const MarkContext& marks);
    void say_that_another_has_gates();
    void warm_up(const DispatchContext& context) const;
    /// @returns null: it is another one
    const DispatchContext* known_as(const EndingContext& ending) const;

    const DriverApi& driver_;
    abi::SharedPage& page_;
    const config::DispatchSettings settings_;
    const std::size_t num_tasks_;
    std::mutex mutex_;
    bool tried_ = false;  // under mutex_
    std::atomic<bool> told_of_other_context_{false};
    // Of any context: the driver may refuse what is asked for in one that ends.
    std::atomic<bool> one_is_ending_{false};
    std::atomic<unsigned> endings_{0};
    DispatchContext context_;  // complete when it is known
    std::atomic<const DispatchContext*> known_{nullptr};
    std::atomic<bool> may_reside_{true}, may_end_{false};
    std::atomic_flag extends_;
    std::atomic<std::uint32_t> leases_{0};  // or arms; written under extends_
    std::atomic<std::int64_t> away_until_ns_{0};
    Arms arms_;
};

}  // namespace urgengo::exec
