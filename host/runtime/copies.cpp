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
//    (runtime/copy_holds.cpp; what they say of themselves: runtime/published_copies.h): from before
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
// A thread whose run has not begun (its first launch tells) is known by its name: its copies are
// cut and paced; it is held for nobody, and holds nobody.
#include <algorithm>
#include <array>
#include <optional>

#include "host/exec/relaxed_capture_mode.h"
#include "host/runtime/runtime.h"

namespace urgengo::runtime {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
/// How much a newly seen speed counts.
constexpr double kNewGbps = 0.125;
/// Nothing that is seen outside of these is a speed.
constexpr double kLeastGbps = 0.1, kMostGbps = 1000;

/// @returns the end's kind, without its range; on no device if the driver does not know it
sched::CopyEnd kind_of_end(const exec::DriverApi& driver, CUdeviceptr address) {
    sched::CopyEnd end;
    end.begin = address;
    unsigned type = 0, managed = 0;
    if (driver.cuPointerGetAttribute(&type, CU_POINTER_ATTRIBUTE_MEMORY_TYPE, address) !=
            CUDA_SUCCESS ||
        driver.cuPointerGetAttribute(&managed, CU_POINTER_ATTRIBUTE_IS_MANAGED, address) !=
            CUDA_SUCCESS ||
        driver.cuPointerGetAttribute(&end.device, CU_POINTER_ATTRIBUTE_DEVICE_ORDINAL, address) !=
            CUDA_SUCCESS)
        return {.begin = address, .on_host = true};
    end.on_host = type != CU_MEMORYTYPE_DEVICE;
    end.is_managed = managed != 0;
    return end;
}

/// Of memory on the device the mapped range, which may be a part of a reserved one.
void find_range(const exec::DriverApi& driver, sched::CopyEnd& end) {
    CUdeviceptr begin = 0;
    std::size_t bytes = 0;
    const auto ask = [&](void* answer, CUpointer_attribute what) {
        return driver.cuPointerGetAttribute(answer, what, end.begin) == CUDA_SUCCESS;
    };
    const bool known =
        end.on_host ? ask(&begin, CU_POINTER_ATTRIBUTE_RANGE_START_ADDR) &&
                          ask(&bytes, CU_POINTER_ATTRIBUTE_RANGE_SIZE)
                    : driver.cuMemGetAddressRange_v2(&begin, &bytes, end.begin) == CUDA_SUCCESS;
    if (!known || end.device < 0) return;
    end.allocation = begin;
    end.bytes = bytes;
}

}  // namespace

// As resolve() finds a launch's task, without the kernel that would tell one candidate from
// another. The name is read again at the next launch as if it had not been read here.
TaskState* Runtime::copying_task(ThreadState& thread) {
    if (TaskState* task = own_task(thread)) return task;
    if (thread.uses_hints || thread.ranged) return nullptr;
    const bool was_fresh = thread.name_is_fresh;
    if (!was_fresh) read_thread_name(thread);
    let_pass_if_nobodys(thread);
    thread.name_is_fresh = was_fresh;
    return thread.num_candidates > 0 ? thread.candidates[0] : nullptr;
}

/// @param[out] on_device  both ends are
std::size_t Runtime::slice_of(const Copy& copy, bool& on_device) const {
    if (!driver_.cuPointerGetAttribute || !driver_.cuMemGetAddressRange_v2) return 0;
    const exec::RelaxedCaptureMode relaxed(driver_);
    sched::CopyEnd to = kind_of_end(driver_, copy.to), from = kind_of_end(driver_, copy.from);
    on_device = !to.on_host && !from.on_host;
    const auto slice = static_cast<std::size_t>(scheduler_.copy_slice_bytes);
    if (slice == 0 || copy.bytes <= slice) return 0;
    find_range(driver_, to);
    find_range(driver_, from);
    return sched::cut_copy(copy.bytes, slice, to, from);
}

CopyTurn Runtime::begin_copy(ThreadState& thread, const Copy& copy) {
    CopyTurn turn;
    if (mode() != config::Mode::kEnforce || copy.bytes == 0) return turn;
    TaskState* task = copying_task(thread);
    if (!task || task->chain->config.mode != config::Mode::kEnforce) return turn;
    if (captures_.is_capturing(copy.stream, copy.flavor)) return turn;
    const auto slice = static_cast<std::size_t>(scheduler_.copy_slice_bytes);
    // With one chain there is nobody to wait for. Where a launch is over when its call returns, an
    // event would not be, and the program would find its stream busy.
    const bool holds = scheduler_.hold_copies && chains_.size() > 1 && !launches_block_;
    if (!holds && (slice == 0 || copy.bytes <= slice)) return turn;
    bool on_device = false;
    turn.slice = slice_of(copy, on_device);
    if (turn.slice > 0) task->copies.num_cut.fetch_add(1, kRelaxed);
    turn.holds = holds && !on_device && !task->copies.busy.exchange(true);
    if (turn.slice > 0 || turn.holds) turn.task = task;
    if (!turn.holds) return turn;
    turn.context = marks_.prepare();
    turn.paces = turn.context && slice > 0;
    if (task->copies.context != turn.context) {
        task->copies.pace.forget();
        task->copies.context = turn.context;
    }
    return turn;
}

void Runtime::end_copy(CopyTurn& turn) {
    if (!turn.holds) return;
    turn.task->copies.published.nothing_came();
    turn.task->copies.busy.store(false, std::memory_order_release);
    turn.holds = false;
}

// The look at others comes last, right before the driver is called: a slice more behind that look
// would be one that the urgent copy waits for, and with it the engine is never seen idle by the
// other channel.
void Runtime::before_slice(ThreadState& thread, const Copy& copy, CopyTurn& turn) {
    if (!turn.holds) return;
    if (turn.paces) make_room(turn);
    PublishedCopies& published = turn.task->copies.published;
    const auto comes = [&] {
        const nanoseconds now = clock_.now();
        published.comes(now + sched::copy_bound(time_at_engine(turn, copy.bytes)));
    };
    comes();
    if (hold_copy(thread, turn)) comes();
    if (turn.has_place) return;
    turn.has_place = true;
    turn.place = published.take_place(clock_.now(), turn.context, [this](CUevent event) {
        const exec::RelaxedCaptureMode relaxed(driver_);
        return driver_.cuEventQuery(event);
    });
    if (turn.context && !turn.place.is_shared) turn.reached = record_before_copy(copy, turn);
}

void Runtime::after_slice(ThreadState& thread, const Copy& copy, CopyTurn& turn,
                          std::size_t bytes) {
    if (!turn.holds) return;
    TaskCopies& copies = turn.task->copies;
    const CUevent end = turn.context ? record_behind_copy(copy, turn, bytes) : nullptr;
    thread.copies_for = turn.task;
    thread.copy_stream = copy.stream;
    thread.copy_flavor = copy.flavor;
    thread.copy = copies.published.submitted(turn.place, {turn.context, turn.reached, end},
                                             clock_.now(), time_at_engine(turn, bytes));
    turn.place.is_shared = true;  // with the slices to come
}

// Before it the engine may have two slices of another task's at hand, and one that came between
// that task's look and what it looked for.
nanoseconds Runtime::time_at_engine(const CopyTurn& turn, std::size_t bytes) const {
    const auto slice = static_cast<std::size_t>(scheduler_.copy_slice_bytes);
    const std::size_t own = std::max(bytes, turn.task->copies.pace.bytes_under_way());
    return sched::copy_time(own + 3 * slice, copy_gbps_.load(kRelaxed)) + sched::kCopyLatency;
}

// --- events

// Of a stream that is found idle nothing needs to be recorded: that would only make the copy wait
// for the event, on another channel of the GPU.
CUevent Runtime::record_before_copy(const Copy& copy, CopyTurn& turn) {
    const auto ask =
        exec::of_flavor(copy.flavor, driver_.cuStreamQuery, driver_.cuStreamQuery_ptsz);
    if (!ask || !driver_.cuEventQuery) return nullptr;
    {
        const exec::RelaxedCaptureMode relaxed(driver_);
        if (ask(copy.stream) != CUDA_ERROR_NOT_READY) return nullptr;
    }
    const CUevent event = copy_event(turn.task->copies, CopyEvents::kReached + turn.place.index);
    return event && record_copy_event(event, copy) ? event : nullptr;
}

/// @returns what tells when all that was submitted is over: a piece's event, or the copy's own; or
///          null, and there will be none for the rest of it
CUevent Runtime::record_behind_copy(const Copy& copy, CopyTurn& turn, std::size_t bytes) {
    TaskCopies& copies = turn.task->copies;
    const bool is_piece =
        turn.paces &&
        copies.pace.copied(bytes, static_cast<std::size_t>(scheduler_.copy_slice_bytes));
    const CUevent event = copy_event(copies, is_piece ? CopyEvents::kPiece + copies.pace.next()
                                                      : CopyEvents::kEnd + turn.place.index);
    if (event && record_copy_event(event, copy)) {
        if (is_piece) copies.pace.marked(clock_.now());
        return event;
    }
    copies.pace.forget();
    turn.paces = false;
    turn.context = nullptr;
    return nullptr;
}

bool Runtime::record_copy_event(CUevent event, const Copy& copy) const {
    const auto record =
        exec::of_flavor(copy.flavor, driver_.cuEventRecord, driver_.cuEventRecord_ptsz);
    return record(event, copy.stream) == CUDA_SUCCESS;
}

/// @param which  CopyEvents::event
/// @returns the event, made at its first use in the context; null if refused
CUevent Runtime::copy_event(TaskCopies& copies, std::size_t which) const {
    if (!driver_.cuEventCreate || !driver_.cuEventQuery || !driver_.cuEventRecord ||
        !driver_.cuEventRecord_ptsz)
        return nullptr;
    auto& all = copies.events;
    auto its = std::find_if(all.begin(), all.end(),
                            [&](const auto& e) { return e.context == copies.context; });
    if (its == all.end()) its = all.insert(its, {copies.context, {}});
    CUevent& event = its->event[which];
    if (event) return event;
    const exec::RelaxedCaptureMode relaxed(driver_);
    if (driver_.cuEventCreate(&event, CU_EVENT_DISABLE_TIMING) != CUDA_SUCCESS) event = nullptr;
    return event;
}

// Until fewer than two pieces are under way. If that cannot be told, or takes too long, the rest of
// this copy goes without.
void Runtime::make_room(CopyTurn& turn) {
    TaskCopies& copies = turn.task->copies;
    if (copies.pace.has_room()) return;
    const exec::RelaxedCaptureMode relaxed(driver_);
    std::optional<FineTimerSlack> slack;
    const double gbps = copy_gbps_.load(kRelaxed);
    for (;;) {
        const CUevent event = copy_event(copies, CopyEvents::kPiece + copies.pace.oldest());
        const CUresult result = driver_.cuEventQuery(event);
        const nanoseconds now = clock_.now();
        if (result == CUDA_SUCCESS) {
            if (const auto seen = copies.pace.finished(now, slack.has_value())) {
                const double speed = std::clamp(*seen, kLeastGbps, kMostGbps);
                copy_gbps_.store(gbps + kNewGbps * (speed - gbps), kRelaxed);
            }
            copies.published.seen(event);
            return;
        }
        if (result != CUDA_ERROR_NOT_READY) copies.pace.forget();
        if (result != CUDA_ERROR_NOT_READY || copies.pace.is_overdue(now) ||
            mode() != config::Mode::kEnforce) {
            turn.paces = false;
            return;
        }
        if (!slack) slack.emplace();
        clock_.sleep_for(copies.pace.sleep(now, gbps, scheduler_.hold_poll));
    }
}

}  // namespace urgengo::runtime
