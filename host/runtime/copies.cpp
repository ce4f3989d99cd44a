// SPDX-License-Identifier: Apache-2.0
//
// Copies (config: `copies:`; off by default). A copy engine serves copies in order, whatever their
// streams' priority, so one large copy delays everybody's by its whole time. Therefore
// (host/sched/copies.h decides, this file asks the driver and waits):
//
//  1 An asynchronous copy of a task that is larger than `slice_bytes` is made as several, on its
//    stream, in order. Only where both ends lie inside one allocation: what the driver would refuse
//    it still refuses as a whole, and with the same error. Pageable host memory is not cut (its
//    copy is another thing), nor is anything that is captured.
//  2 With `hold: on` two slices of a task are under way at most. An event of ours is behind each;
//    the thread sleeps until the one before the last is over. A slice that is late by more than
//    twice its time at 10 GB/s and 1 ms waits for something else on its stream: the rest goes at
//    once.
//  3 And right before each slice, or whole copy, the thread waits like a launch that is held,
//    bounded and counted like one, while a more urgent task has copies at the engine
//    (runtime/copy_holds.cpp; what they say of themselves: exec/published_copies.h): from before
//    they are submitted, or their stream has reached them, until an event behind them, or a wait of
//    the program, tells that they are over. So nothing waits for what cannot be seen to end.
//
// Why that is exact at both ends: the engine goes on with a channel (a stream, mostly) for as long
// as it finds copies there (H200, driver 580.159.04). One slice too early, while the urgent copy is
// not over, and it waits not for that slice but for all of the large copy: 4 % of the urgent ones
// did, 1.7 to 9.8 ms, when the time that they should take was what ended a hold.
//
// What it costs: 3 us a slice, held or not, which the engine needs between two (2.8 at 4 MiB, 3.1
// at 8; events and sleeps are behind the slice that is under way). So slices are as large as the
// wait for two of them allows: 10 MiB, at 55 GB/s, are 1.6 % and 0.38 ms. More of smaller ones
// under way would cost more for the same wait; a single one would leave the engine idle in between.
//
// Copies on the device are cut, coarsely, and neither held nor paced: they are over at once.
//
// A thread whose run has not begun (its first launch tells) is known by its name. Its copies are
// cut and paced. They wait for no other task, and no other task waits for them.
#include "host/runtime/copies.h"

#include <algorithm>
#include <optional>

#include "host/base/memory_orders.h"
#include "host/exec/relaxed_capture_mode.h"
#include "host/runtime/thread_state.h"

namespace urgengo::runtime {
namespace {

/// How much a newly seen speed counts.
constexpr double kNewGbps = 0.125;
/// Nothing that is seen outside of these is a speed.
constexpr double kLeastGbps = 0.1, kMostGbps = 1000;

}  // namespace

// With one chain there is no other task to wait for. Where a launch is over when its call returns,
// an event would not be, and the program would find its stream busy.
Copies::Copies(const config::Scheduler& scheduler, bool may_hold, const Around& around,
               CopyingThreads& threads)
    : rules_{.wanted = scheduler.copies.hold || scheduler.copies.slice_bytes != 0,
             .hold = scheduler.copies.hold && may_hold,
             .slice_bytes = static_cast<std::size_t>(scheduler.copies.slice_bytes),
             .poll = scheduler.hold.poll},
      around_(around),
      threads_(threads) {}

CUevent Copies::event_of(TaskCopies& copies, std::size_t which) const {
    return copies.events.at(around_.driver, copies.context, which);
}

CopyTurn Copies::begin(ThreadState& thread, const Copy& copy) {
    CopyTurn turn;
    if (!around_.governor.steered().enforces() || copy.bytes == 0) return turn;
    TaskState* task = threads_.copying_task(thread);
    if (!task || task->chain->mode() != config::Mode::kEnforce) return turn;
    if (around_.captures.is_capturing(copy.stream, copy.flavor)) return turn;
    if (!rules_.hold && (rules_.slice_bytes == 0 || copy.bytes <= rules_.slice_bytes)) return turn;
    bool on_device = false;
    turn.slice = exec::slice_of(around_.driver, copy, rules_.slice_bytes, on_device);
    if (turn.slice > 0) task->copies.num_cut.fetch_add(1, kRelaxed);
    turn.holds = rules_.hold && !on_device && !task->copies.busy.exchange(true);
    if (turn.slice > 0 || turn.holds) turn.task = task;
    if (!turn.holds) return turn;
    turn.context = around_.marks.prepare();
    turn.paces = turn.context && rules_.slice_bytes > 0;
    if (task->copies.context != turn.context) {
        task->copies.pace.forget();
        task->copies.context = turn.context;
    }
    return turn;
}

void Copies::end(CopyTurn& turn) {
    if (!turn.holds) return;
    turn.task->copies.published.nothing_came();
    turn.task->copies.busy.store(false, std::memory_order_release);
    turn.holds = false;
}

// The look at others comes last, right before the driver is called: a slice more behind that look
// would be one that the urgent copy waits for, and with it the engine is never seen idle by the
// other channel.
void Copies::before_slice(ThreadState& thread, const Copy& copy, CopyTurn& turn) {
    if (!turn.holds) return;
    if (turn.paces) make_room(turn);
    exec::PublishedCopies& published = turn.task->copies.published;
    const auto comes = [&] {
        const nanoseconds now = around_.clock.now();
        published.comes(now + sched::copy_bound(time_at_engine(turn, copy.bytes)));
    };
    comes();
    if (hold(thread, turn)) comes();
    if (turn.has_place) return;
    turn.has_place = true;
    turn.place = published.take_place(around_.clock.now(), turn.context, [this](CUevent event) {
        const exec::RelaxedCaptureMode relaxed(around_.driver);
        return around_.driver.cuEventQuery(event);
    });
    if (turn.context && !turn.place.is_shared) turn.reached = record_before_copy(copy, turn);
}

void Copies::after_slice(ThreadState& thread, const Copy& copy, CopyTurn& turn, std::size_t bytes) {
    if (!turn.holds) return;
    TaskCopies& copies = turn.task->copies;
    const CUevent end = turn.context ? record_behind_copy(copy, turn, bytes) : nullptr;
    thread.copied = {
        .task = turn.task,
        .ticket = copies.published.submitted(turn.place, {turn.context, turn.reached, end},
                                             around_.clock.now(), time_at_engine(turn, bytes)),
        .stream = copy.stream,
        .flavor = copy.flavor};
    turn.place.is_shared = true;  // with the slices to come
}

// Before it the engine may have two slices of another task's at hand, and one that came between
// that task's look and what it looked for.
nanoseconds Copies::time_at_engine(const CopyTurn& turn, std::size_t bytes) const {
    const std::size_t own = std::max(bytes, turn.task->copies.pace.bytes_under_way());
    return sched::copy_time(own + 3 * rules_.slice_bytes, gbps_.load(kRelaxed)) +
           sched::kCopyLatency;
}

// --- events

// Of a stream that is found idle nothing needs to be recorded: that would only make the copy wait
// for the event, on another channel of the GPU.
CUevent Copies::record_before_copy(const Copy& copy, CopyTurn& turn) {
    const auto ask = exec::of_flavor(copy.flavor, around_.driver.cuStreamQuery,
                                     around_.driver.cuStreamQuery_ptsz);
    if (!ask || !around_.driver.cuEventQuery) return nullptr;
    {
        const exec::RelaxedCaptureMode relaxed(around_.driver);
        if (ask(copy.stream) != CUDA_ERROR_NOT_READY) return nullptr;
    }
    const CUevent event = event_of(turn.task->copies, CopyEvents::kReached + turn.place.index);
    return event && exec::record_event(around_.driver, event, copy.stream, copy.flavor) ? event
                                                                                        : nullptr;
}

/// @returns what tells when all that was submitted is over: a piece's event, or the copy's own; or
///          null, and there will be none for the rest of it
CUevent Copies::record_behind_copy(const Copy& copy, CopyTurn& turn, std::size_t bytes) {
    TaskCopies& copies = turn.task->copies;
    const bool is_piece = turn.paces && copies.pace.copied(bytes, rules_.slice_bytes);
    const CUevent event = event_of(copies, is_piece ? CopyEvents::kPiece + copies.pace.next()
                                                    : CopyEvents::kEnd + turn.place.index);
    if (event && exec::record_event(around_.driver, event, copy.stream, copy.flavor)) {
        if (is_piece) copies.pace.marked(around_.clock.now());
        return event;
    }
    copies.pace.forget();
    turn.paces = false;
    turn.context = nullptr;
    return nullptr;
}

// Until fewer than two pieces are under way. If that cannot be told, or takes too long, the rest of
// this copy goes without.
void Copies::make_room(CopyTurn& turn) {
    TaskCopies& copies = turn.task->copies;
    if (copies.pace.has_room()) return;
    const exec::RelaxedCaptureMode relaxed(around_.driver);
    std::optional<FineTimerSlack> slack;
    const double gbps = gbps_.load(kRelaxed);
    for (;;) {
        const CUevent event = event_of(copies, CopyEvents::kPiece + copies.pace.oldest());
        const CUresult result = around_.driver.cuEventQuery(event);
        const nanoseconds now = around_.clock.now();
        if (result == CUDA_SUCCESS) {
            if (const auto seen = copies.pace.finished(now, slack.has_value())) {
                const double speed = std::clamp(*seen, kLeastGbps, kMostGbps);
                gbps_.store(gbps + kNewGbps * (speed - gbps), kRelaxed);
            }
            copies.published.seen(event);
            return;
        }
        if (result != CUDA_ERROR_NOT_READY) copies.pace.forget();
        if (result != CUDA_ERROR_NOT_READY || copies.pace.is_overdue(now) ||
            !around_.governor.steered().enforces()) {
            turn.paces = false;
            return;
        }
        if (!slack) slack.emplace();
        around_.clock.sleep_for(copies.pace.sleep(now, gbps, rules_.poll));
    }
}

}  // namespace urgengo::runtime
