// SPDX-License-Identifier: Apache-2.0
//
// Progress source `event`: an event without timing behind the program's work, which costs the GPU
// nothing, and a poller that asks for the events in order and writes into a task's line what a mark
// kernel would have (measured costs: 0.3 us to record, 0.09 us to ask while pending, 1.2 us once
// complete; H200, driver 580.159.04, 2026-11-21).
//
// Every line has a ring of events of its own, made at its first mark and used again and again. One
// thread at a time records (the one that has the task), one looks (the poller): neither waits for
// the other. A full ring means that so many marks are under way that another would tell nothing
// soon.
//
// Rules:
//  1 In a line, events are asked for in the order in which they were recorded: what is published
//    vouches for all before it, whatever streams the task went through.
//  2 The poller makes no driver call but between begin and end of one poll(), with the lock held.
//    So drop(), which takes it, knows that no event is touched when it returns: the context may
//    then go.
//  3 Its calls are made in relaxed capture mode: in any other, a question of ours would end a
//    capture of the program's. The context that they need is current in the poller's thread alone.
//  4 A context whose events cannot be recorded or asked for is given up: record() answers with an
//    error from then on, and its caller marks in another way.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>

#include "host/base/clock.h"
#include "host/exec/driver_api.h"
#include "host/exec/poller.h"
#include "host/model/task_set.h"
#include "urgengo/abi/device_mailbox.h"
#include "urgengo/abi/shared_page.h"

namespace urgengo::exec {

/// What a mark says, and behind what.
struct Mark {
    int task = 0;  ///< the line
    std::uint64_t word0 = 0;
    std::uint32_t sequence = 0;
    CUstream stream = nullptr;
    StreamFlavor flavor = StreamFlavor::kLegacy;
    bool may_overlap = false;  ///< nothing before it on the stream overlaps programmatically
    nanoseconds time{0};       ///< before it is put there
    bool is_watched = true;    ///< others want to know soon
    std::uint32_t gate = 0;    ///< the last closed one of its task, which is behind it if at all
    bool is_before_gate = false, ends_segment = false;
    unsigned threads = 1;  ///< of a mark kernel: MarkWidth
};

/// A context that goes, or may go: the one with this handle, all of this device, or, with neither,
/// any.
struct EndingContext {
    CUcontext handle = nullptr;
    CUdevice device = -1;
    bool may_be(CUcontext context, CUdevice its_device) const {
        if (!handle && device < 0) return true;
        return handle ? handle == context : device == its_device;
    }
};

/// The events of one context; never destroyed, but used for another context when that has ended.
struct EventContext {
    /// More than a task has marks under way (gpu_segments.cpp), so that with an event behind every
    /// kernel hardly any is left out: with 32, positions were ahead in 1.5 % of cases (H200).
    static constexpr std::uint32_t kRing = abi::kMarkRing;

    struct Entry {
        CUevent event = nullptr;
        std::uint64_t word0 = 0;
        std::uint16_t tag = 0;
        nanoseconds recorded{0};  ///< not before this
    };
    struct Line {
        bool is_made = false;
        nanoseconds pending_at{0};  ///< when the first that is not complete was seen not to be
        std::unique_ptr<std::array<Entry, kRing>> ring;  ///< made at the line's first mark
        std::atomic<std::uint32_t> num_recorded{0};
        std::atomic<std::uint32_t> num_seen{0};  ///< complete
    };

    CUcontext handle = nullptr;  ///< null: of no context
    CUdevice device = 0;
    ug_mark_line* lines = nullptr;      ///< where the poller publishes
    std::atomic<bool> given_up{false};  ///< its events are not touched any more
    model::SharedTaskSet pending;       ///< lines that may have events under way
    std::array<Line, abi::kMaxTasks> line;
};

class EventMarks {
  public:
    /// @param driver, poller  outlive this
    EventMarks(const DriverApi& driver, Poller& poller)
        : driver_(driver), poller_(poller), next_(g_all.load()) {
        while (!g_all.compare_exchange_weak(next_, this)) {
        }
    }

    /// Starts the poller, if nothing has yet.
    /// @returns the current context's events; null: this source cannot be had
    /// @threads caller makes the calls one after the other
    EventContext* add(CUcontext handle, CUdevice device, ug_mark_line* lines);

    /// Records an event behind what is on the stream.
    /// @returns CUDA_ERROR_NOT_READY if the line's ring is full: nothing was recorded
    /// @threads one at a time per line
    CUresult record(EventContext& context, const Mark& mark);

    /// One look at all that is under way. Of what is complete, the last is published, with the
    /// time at which it mostly was: evenly between the last look and this one, not now.
    /// @returns whether anything is under way still; kSoon: and a task watches
    /// @threads the poller's
    More poll(Clock& clock);

    /// An arriving task wants to know soon; until a mark says that no task does.
    /// @threads any
    void watch() { is_watched_.store(true, std::memory_order_relaxed); }

    /// Before contexts go: their events are not touched any more when this returns.
    void drop(const EndingContext& ending);
    /// Of a context that has ended.
    /// @threads as add()
    void make_free(EventContext& context);

  private:
    static constexpr int kMaxContexts = 64;
    bool make_ring(EventContext::Line& line) const;
    static void publish_last(EventContext& context, int task, std::uint32_t n, nanoseconds now);
    void look_at(EventContext& context, int task, Clock& clock);
    bool make_current(CUcontext context);

    const DriverApi& driver_;
    Poller& poller_;
    bool is_started_ = false;
    std::array<EventContext*, kMaxContexts> contexts_{};
    std::atomic<int> num_contexts_{0};
    std::atomic<bool> is_watched_{true};
    std::mutex mutex_;
    CUcontext current_ = nullptr;  // in the poller's thread; under mutex_

    // Never destroyed, as the poller's thread may look at any time: all that ever were.
    inline static std::atomic<EventMarks*> g_all{nullptr};
    EventMarks* next_;
};

}  // namespace urgengo::exec
