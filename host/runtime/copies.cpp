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
//  3 And before each slice, or whole copy, the thread waits like a launch that is held, bounded and
//    counted like one, while a more urgent task has copies that are believed unfinished: until a
//    wait for them, or for the time that they should take. So nothing waits for what cannot be seen
//    to end.
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
    if (!thread.name_is_fresh) {
        read_thread_name(thread);
        thread.name_is_fresh = false;
    }
    if (thread.num_candidates > 0) return thread.candidates[0];
    let_pass_if_nobodys(thread);
    return nullptr;
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
    if (!turn.holds || slice == 0) return turn;
    turn.context = marks_.prepare();
    if (task->copies.context != turn.context) {
        task->copies.pace.forget();
        task->copies.context = turn.context;
    }
    return turn;
}

void Runtime::end_copy(CopyTurn& turn) {
    if (turn.holds) turn.task->copies.busy.store(false, std::memory_order_release);
    turn.holds = false;
}

void Runtime::before_slice(ThreadState& thread, CopyTurn& turn) {
    if (!turn.holds) return;
    hold_copy(thread, *turn.task);
    if (turn.context) make_room(turn);
}

void Runtime::after_slice(ThreadState& thread, const Copy& copy, CopyTurn& turn,
                          std::size_t bytes) {
    if (!turn.holds) return;
    thread.copies_for = turn.task;
    thread.copy_stream = copy.stream;
    thread.copy_flavor = copy.flavor;
    TaskCopies& copies = turn.task->copies;
    const auto slice = static_cast<std::size_t>(scheduler_.copy_slice_bytes);
    const nanoseconds now = clock_.now();
    if (turn.context && copies.pace.copied(bytes, slice)) {
        const auto record =
            exec::of_flavor(copy.flavor, driver_.cuEventRecord, driver_.cuEventRecord_ptsz);
        const CUevent event = copy_event(copies, copies.pace.next());
        if (event && record(event, copy.stream) == CUDA_SUCCESS) {
            copies.pace.marked(now);
        } else {
            copies.pace.forget();
            turn.context = nullptr;
        }
    }
    // Before them the engine may have two slices of another task's at hand.
    const std::size_t at_hand = std::max(bytes, copies.pace.bytes_under_way()) + 2 * slice;
    const nanoseconds time = sched::copy_time(at_hand, copy_gbps_.load(kRelaxed));
    copies.unfinished_until_ns.store((now + time + sched::kCopyLatency).count(), kRelaxed);
}

/// @returns the event of that place, made at its first use in the context; null if refused
CUevent Runtime::copy_event(TaskCopies& copies, std::size_t place) const {
    if (!driver_.cuEventCreate || !driver_.cuEventQuery || !driver_.cuEventRecord ||
        !driver_.cuEventRecord_ptsz)
        return nullptr;
    auto& all = copies.events;
    auto its = std::find_if(all.begin(), all.end(),
                            [&](const auto& e) { return e.context == copies.context; });
    if (its == all.end()) its = all.insert(its, {copies.context, {}});
    CUevent& event = its->event[place];
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
        const CUresult result = driver_.cuEventQuery(copy_event(copies, copies.pace.oldest()));
        const nanoseconds now = clock_.now();
        if (result == CUDA_SUCCESS) {
            if (const auto seen = copies.pace.finished(now, slack.has_value())) {
                const double speed = std::clamp(*seen, kLeastGbps, kMostGbps);
                copy_gbps_.store(gbps + kNewGbps * (speed - gbps), kRelaxed);
            }
            return;
        }
        if (result != CUDA_ERROR_NOT_READY) copies.pace.forget();
        if (result != CUDA_ERROR_NOT_READY || copies.pace.is_overdue(now) ||
            mode() != config::Mode::kEnforce) {
            turn.context = nullptr;
            return;
        }
        if (!slack) slack.emplace();
        clock_.sleep_for(copies.pace.sleep(now, gbps, scheduler_.hold_poll));
    }
}

// --- holding

bool Runtime::any_copies_but(const TaskState& task, nanoseconds now) const {
    return std::any_of(tasks_.begin(), tasks_.end(), [&](const auto& other) {
        return other.get() != &task &&
               other->copies.unfinished_until_ns.load(kRelaxed) > now.count();
    });
}

bool Runtime::urgent_copies(TaskState& task, nanoseconds now) {
    if (!any_copies_but(task, now)) return false;
    std::array<model::SlotView, abi::kMaxTasks> views;
    std::array<bool, abi::kMaxTasks> unfinished{};
    std::size_t num_views = 0;
    const auto add = [&](TaskState& other) {
        const model::SlotView view = look_at(other, now);
        if (!view.active) return false;
        unfinished[num_views] = other.copies.unfinished_until_ns.load(kRelaxed) > now.count();
        views[num_views++] = view;
        return true;
    };
    if (!add(task)) return false;
    for (const auto& other : tasks_)
        if (other.get() != &task) add(*other);
    std::uint32_t changes = page_->changes.load(kRelaxed);
    return sched::copy_must_wait(scheduler_,
                                 {now,
                                  {views.data(), num_views},
                                  plan(now, changes),
                                  urgent_threshold_.laxity(),
                                  static_cast<int>(chains_.size()),
                                  num_levels(task)},
                                 {unfinished.data(), num_views});
}

// Its thread alone waits, at its task: as with a launch, helpers go unscheduled meanwhile. Not
// between two events that take the time.
void Runtime::hold_copy(ThreadState& thread, TaskState& task) {
    nanoseconds last = clock_.now();
    if (!any_copies_but(task, last)) return;
    if (own_task(thread) != &task || thread.measuring || !take(thread, task)) return;
    TaskRun& run = task.run;
    const nanoseconds bound = hold_bound(task);
    if (!run.observed && run.held < bound && urgent_copies(task, last)) {
        bump(task.counters.holds);
        const FineTimerSlack slack;
        do {
            clock_.sleep_for(scheduler_.hold_poll);
            const nanoseconds now = clock_.now();
            run.held += now - last;
            bump(task.counters.held_ns, std::int64_t{(now - last).count()});
            last = now;
            if (run.held >= bound) bump(task.counters.holds_opened);
        } while (run.held < bound && mode() == config::Mode::kEnforce && urgent_copies(task, last));
    }
    release(thread);
}

// The thread has waited for its copies: others may go on.
void Runtime::copies_waited_for(ThreadState& thread, const Wait& wait) {
    const bool names_stream = wait.function == abi::TraceWait::kStream ||
                              wait.function == abi::TraceWait::kStreamQuery ||
                              wait.function == abi::TraceWait::kCopy;
    const bool its_stream = names_stream && wait.stream == thread.copy_stream &&
                            (wait.stream || wait.flavor == thread.copy_flavor);
    if (wait.function != abi::TraceWait::kContext && !its_stream) return;
    thread.copies_for->copies.unfinished_until_ns.store(0, kRelaxed);
    thread.copies_for = nullptr;
}

}  // namespace urgengo::runtime
