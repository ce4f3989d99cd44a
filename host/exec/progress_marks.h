// SPDX-License-Identifier: Apache-2.0
//
// Progress marks: behind the program's own work, on the program's stream, something that writes
// into a task's line (include/urgengo/abi/device_mailbox.h) once that work has executed. What it
// is, the source, is the config's choice:
//
//   kernel  a kernel of one block at the highest priority: it waits for a free block slot, at the
//           lowest 3.5 ms behind a kernel that fills the GPU, at the highest 126 us. 1.7 to 1.9 us
//           of GPU time; 0.8 to 1.0 us launched with programmatic serialisation, where the GPU can;
//           0.7 to 0.8 more on hosts farther from the GPU. Half of it is waiting for the write to
//           arrive in the host's memory (0.6 us into the GPU's own, and 0.5 for a kernel that
//           writes nothing), whatever the memory, the readers meanwhile, and how launches are
//           paced.
//   memop   two stream writes: need no slot, 4 us late on the full GPU, 2.0 us of GPU time each at
//           most; no timestamp.
//   event   exec/event_marks.h: no GPU time, 2 us late and what the poller adds.
//   (measured, H200, driver 580.159.04, 2026-11-21)
//
// How many threads it has: exec/mark_width.h.
//
// Tried, and left: a mark on a stream of ours that waits for an event of the program's. It takes
// 0.03 to 0.09 us of the program's stream, but is 13 to 60 us late beside kernels that fill six of
// eight block slots or more (0.9 us in the stream), and with one or two connections
// (CUDA_DEVICE_MAX_CONNECTIONS) its wait kept other streams of the program from the GPU. (The same,
// 2026-11-22.)
//
// What the driver refuses is marked by kernels instead, in that context, from then on.
//
// Programmatic serialisation keeps the stream's order. The mark may start while what is before it
// runs, and does nothing until griddepcontrol.wait returns: when the grid before it has completed
// and its writes are flushed, however early that grid let its dependents start
// (griddepcontrol.launch_dependents). The mark itself never lets dependents start. So whatever
// comes after it, which waits for the mark as for any kernel, comes after what was before it, too.
// Three conditions:
//  - the kernel's code has the wait: that of compute capability 9.0 and up, not PTX for an older
//    one that the driver has compiled for a newer GPU;
//  - what is before does not itself overlap what is before that: its end would vouch for nothing
//    else (Mark::may_overlap);
//  - the driver takes the attribute; if not, marks are launched plainly from then on.
//
// Every context has its own mailbox, in memory of ours that is registered there: it outlives the
// context, so a reader never faults, and no GPU ever writes through another context's registration.
// Contexts are told apart by id, because their handles are reused. What is known of one is never
// used for another, and stays when it has ended, for users that still have it: a pointer to it
// stands for that context for good. Its place in the table and its events go to another, and its
// mailbox, once many have ended since: a task that was asleep through all of those and launches
// again finds another context (TaskState::line_of).
//
// Calls the driver in the program's thread and its current context, and changes neither. Set-up
// runs in relaxed capture mode: in a global-mode capture a module load of ours in any thread would
// invalidate the program's capture.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>

#include "host/config/config.h"
#include "host/exec/dispatcher.h"
#include "host/exec/driver_api.h"
#include "host/exec/event_marks.h"
#include "host/exec/relaxed_capture_mode.h"
#include "urgengo/abi/device_mailbox.h"
#include "urgengo/abi/shared_page.h"

namespace urgengo::exec {

/// What marks need in one context. Complete when it is seen; what is mutable changes once. Never
/// destroyed; another's long after that context has ended.
struct MarkContext {
    unsigned long long id = 0;
    CUcontext handle = nullptr;
    CUdevice device = 0;
    CUfunction kernel = nullptr;     ///< null: this context gets no marks
    CUfunction delay = nullptr;      ///< keeps a stream busy for a time in ns; may be null
    ug_mark_line* lines = nullptr;   ///< a task each, host address
    CUdeviceptr d_lines = 0;         ///< the same, as the GPU sees it
    EventContext* events = nullptr;  ///< of source `event`
    int least_priority = 0;
    int greatest_priority = 0;
    int num_sms = 0;
    double resident_threads = 1;  ///< threads that the GPU can hold at once
    /// To kKernel when the driver has refused another. Never kAuto.
    mutable std::atomic<config::ProgressSource> source{config::ProgressSource::kKernel};
    mutable std::atomic<bool> overlaps{false};  ///< mark kernels, programmatically
    /// Not null: marks open gates, too.
    mutable std::atomic<const DispatchContext*> dispatch{nullptr};
};

class ProgressMarks {
  public:
    /// Marks of the context open gates from now on.
    static void dispatch_by(const MarkContext& context, const DispatchContext& dispatch) {
        context.dispatch.store(&dispatch, std::memory_order_release);
    }
    void use(const Dispatcher& dispatcher) { dispatcher_ = &dispatcher; }

    /// @param source   not kAuto
    /// @param poller   of source `event`; null: a thread, made when a context needs it
    /// @param at_once  that thread sees at once what there is to see, for a core's time
    /// @param num_lines  tasks that there are, at most abi::kMaxTasks; none: kernels are timed all
    ///                   the same
    explicit ProgressMarks(const DriverApi& driver,
                           config::ProgressSource source = config::ProgressSource::kKernel,
                           Poller* poller = nullptr, bool at_once = false,
                           std::size_t num_lines = abi::kMaxTasks)
        : driver_(driver),
          source_(source),
          at_once_(at_once),
          num_lines_(std::max<std::size_t>(num_lines, 1)),
          poller_(poller) {}

    /// Makes marks possible in the calling thread's current context.
    /// @returns null if it gets none: none is current, the driver refused, or there are too many
    /// @threads any; takes a lock only for a context that it has not seen
    const MarkContext* prepare();

    /// Puts a mark behind what is on the stream.
    /// @param context  as prepare() answered, and still current
    /// @returns CUDA_ERROR_NOT_READY if there is no room: nothing was put there, ask again later
    /// @threads one at a time per line
    CUresult emit(const MarkContext& context, const Mark& mark);

    /// An arriving task wants to know soon how far the others are.
    void watch() {
        if (EventMarks* events = events_.load(std::memory_order_acquire)) events->watch();
    }

    /// Launches a mark kernel that writes to a line anywhere in mapped memory.
    CUresult launch_at(const MarkContext& context, CUdeviceptr d_line, std::uint64_t word0,
                       std::uint32_t sequence, CUstream stream, StreamFlavor flavor,
                       bool may_overlap = false, unsigned threads = 1) const;

    /// Before and after a context goes, or may go: nothing of it is touched any more.
    void context_ends(const EndingContext& ending);
    /// After it, last: what has gone makes room for others.
    /// @param forget  (unsigned long long id): called of each context that has
    void context_ended(const EndingContext& ending,
                       const std::function<void(unsigned long long)>& forget);

    /// @returns `count` lines, mapped into the current context as `d_lines`; null if refused. They
    ///          are never unmapped: the GPU may write to them for as long as it runs.
    ug_mark_line* allocate_lines(std::size_t count, CUdeviceptr& d_lines) const;

    const DriverApi& driver() const { return driver_; }

  private:
    static constexpr std::size_t kMaxContexts = 64;  ///< at a time
    static constexpr std::size_t kKeptEnded = 64;    ///< at least

    const MarkContext* find(unsigned long long id) const;
    const MarkContext* load(unsigned long long id, CUcontext handle);
    MarkContext& new_context();
    void set_up_on_roomy_stack(MarkContext& context);
    bool set_up(MarkContext& context);
    bool share_lines(ug_mark_line* lines, std::size_t count, CUdeviceptr& d_lines) const;
    bool may_overlap(const MarkContext& context) const;
    void choose_source(MarkContext& context);
    CUresult write_words(const MarkContext& context, const Mark& mark) const;

    const DriverApi& driver_;
    const Dispatcher* dispatcher_ = nullptr;
    const config::ProgressSource source_;
    const bool at_once_;
    const std::size_t num_lines_;
    Poller* poller_;
    std::mutex mutex_;
    std::atomic<EventMarks*> events_{nullptr};  // made under mutex_, never destroyed
    std::deque<MarkContext> all_;               // that are known
    std::deque<MarkContext*> ended_;            // of those, the longest ago first
    std::array<std::atomic<const MarkContext*>, kMaxContexts> contexts_{};  // those that are
    bool told_ = false;                                                     // that there are more
};

}  // namespace urgengo::exec
