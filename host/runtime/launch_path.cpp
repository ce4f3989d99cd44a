// SPDX-License-Identifier: Apache-2.0
//
// The life of a launch (host/README.md), between the interposer and the decision:
//
//  1 resolve()            whose launch is it? Of no chain: untouched.
//  2 estimate()           E_k and U_k from the plan, by position, else by name and size.
//  3 publish              the slot in the active kernel buffer says what is about to be launched.
//  4 hold_until_admitted  run-ahead within its bound, and the packed admission says go; else sleep
//                         a little and look again.
//  5 the caller launches, at the priority of the rank.
//  6 after()              position and estimates move on; a mark, once enough has been launched.
//
// Numbers on the GPU's side of a task are counted in "marks": sequence numbers in the slot, with
// the GPU time that remains after each in a ring, so that any thread can tell from one progress
// word what remains of any task.
#include "host/runtime/launch_path.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "host/base/memory_orders.h"
#include "host/base/own_time.h"
#include "host/runtime/estimates.h"
#include "host/sched/instance_slot.h"

namespace urgengo::runtime {
namespace {

using abi::TaskSlot;

/// A graph that the plan does not know: it counts as filling the GPU.
constexpr nanoseconds kGraph{1'000'000};

}  // namespace

model::KernelEstimate LaunchPath::estimate(TaskState& task, const Launch& launch,
                                           const model::KernelKey& key, double graph_utilization) {
    const std::size_t position = task.tracker.position() - (task.tracker.in_segment() ? 1 : 0);
    model::KernelEstimate estimate{kGraph, graph_utilization};
    if (const auto known = task.plan.find(position, key)) {
        estimate = *known;
    } else {
        if (!task.plan.is_empty()) bump(task.counters.unknown);
        if (launch.function) estimate = unknown_kernel(task, launch);
    }
    if (task.learning) [[unlikely]] {
        const auto learned =
            task.learning->durations().find(task.run.position, model::kernel_id(key));
        estimate.gpu_time = learned.value_or(estimate.gpu_time);
    }
    return estimate;
}

// A launch that goes as planned is not asked about: so such kernels are none of any plan's.
void LaunchPath::find_room(const Launch& launch, identity::KnownKernel& kernel, nanoseconds until) {
    constexpr std::uint32_t kAlwaysRoom_bytes = 32 << 10;  // half of any GPU's have more
    GateKeeper& keeper = common_.gate_keeper;
    const std::uint64_t threads = launch.grid_blocks * launch.block_threads;
    if (launch.shared_bytes <= kAlwaysRoom_bytes && !keeper.fills_gpu(threads)) [[likely]]
        return;
    kernel.needs_room = keeper.is_leased();
    keeper.find_room(launch.shared_bytes, threads, until);
}

Grant LaunchPath::before(ThreadState& thread, const Launch& launch) {
    const Grant grant = decide(thread, launch);
    // Last, so that a hold is not taken for the kernel's time.
    if (grant.traced) [[unlikely]]
        common_.tracer.launch_begins(thread, launch);
    return grant;
}

Grant LaunchPath::decide(ThreadState& thread, const Launch& launch) {
    Grant grant;
    if (common_.mode() == config::Mode::kOff) return grant;
    if (common_.streams.is_capturing(launch.stream, launch.flavor)) return grant;
    identity::KnownKernel& kernel =
        common_.kernels.find(thread.kernels, thread.tracing.cursor, launch);
    const model::KernelKey key{kernel.name_hash, launch.grid_blocks, launch.block_threads};
    grant.time = common_.clock.now();
    TaskState* task = around_.resolver.resolve(thread, launch, key,
                                               launch.function ? &kernel : nullptr, grant.time);
    grant.task = task;
    grant.traced = common_.tracer.is_on();
    // Programs that time single kernels choose between them; who times a graph times an inference.
    grant.may_be_timed = std::exchange(thread.measuring, false) && launch.function;
    if (!task) {
        // A launch of a chain, of whose tasks none was found, is not a bystander's.
        if (!around_.resolver.may_be_chains(thread, launch))
            common_.governor.bystanders().launched();
        find_room(launch, kernel, grant.time);
        grant.may_load = std::exchange(kernel.is_new, false) && common_.gate_keeper.are_on();
        return grant;
    }
    sched::GovernedRun& run = task->run;
    TrackedRun& tracked = task->tracked;
    // Another stream, or a default stream, may mean another context: marks are per context.
    if (run.on_gpu && (tracked.stream != launch.stream || exec::is_default_stream(launch.stream)) &&
        common_.marks.prepare() != tracked.marks)
        around_.segments.leave(*task, false);
    // A mark vouches for what is on its stream, or before it there.
    around_.streams.follow(*task, launch);
    tracked.moved = tracked.stream != launch.stream || tracked.flavor != launch.flavor;
    tracked.stream = launch.stream;
    tracked.flavor = launch.flavor;
    if (!task->chain->may_act()) [[unlikely]] {
        run.only_decides = true;
        if (!run.observed && !task->chain->may_be_scheduled())
            around_.runs.observe_from_here(*task, grant.time);
    }
    // Without progress there is no scheduling: neither after a refused mark, nor where marks cannot
    // be.
    if (!common_.governor.schedules() || tracked.marks_refused || run.observed) {
        // It was switched to looking on: what is launched from here on is in no estimate.
        if (run.on_gpu) around_.segments.leave(*task, false);
        grant.may_load = std::exchange(kernel.is_new, false) && common_.gate_keeper.are_on();
        return grant;
    }
    if (!run.on_gpu && !around_.segments.enter(*task, grant.time)) return grant;

    grant.scheduled = true;
    // A helper launches meanwhile, or the program has jumped out of the wait.
    if (task->slot->waits.load(kRelaxed) != 0) [[unlikely]]
        task->slot->waits.store(0, kRelaxed);
    const model::KernelEstimate estimated = estimate(*task, launch, key, kernel.utilization);
    grant.estimate = run.next = estimated.gpu_time;
    common_.mark_width.launches({.blocks = launch.grid_blocks,
                                 .block_threads = launch.block_threads,
                                 .shared_bytes = launch.shared_bytes,
                                 .time = estimated.gpu_time},
                                tracked.marks->num_sms, grant.time);
    grant.kernel = model::kernel_id(key);
    task->slot->head_utilization_ppm.store(model::to_ppm(estimated.utilization), kRelaxed);
    if (launch.depends_on_previous) task->record.overlaps = true;
    grant.context = tracked.marks;
    const bool at_once = launch.depends_on_previous || grant.may_be_timed;
    around_.segments.see_whether_slow(*task, grant.time);
    // Of a move, only within an instance, to where all of it is joined.
    const bool is_behind = !tracked.moved || (run.position > 0 && around_.segments.vouches(*task));
    if (!at_once && is_behind && around_.segments.mark_is_due(*task, grant.time) &&
        !around_.segments.must_have_executed(*task, grant.time) &&
        around_.segments.vouches(*task)) {
        const std::uint32_t issued = task->slot->marks_issued.load(kRelaxed);
        around_.segments.mark_if_worth_it(*task, grant.time);
        run.mark.tells = task->plan.is_empty() && task->slot->marks_issued.load(kRelaxed) != issued;
    }
    // The batch after next begins, or goes on, when the last but one has executed.
    if (!at_once && !common_.follows_marks() && around_.segments.wait_for_batches(*task, 1))
        grant.time = common_.clock.now();
    if (!run.on_gpu) return grant;  // the mark was refused
    const sched::Decision decision = at_once
                                         ? ask(*task, grant.time).decision
                                         : hold_until_admitted(*task, !kernel.is_new, grant.time);
    if (common_.scheduler.binding != config::Binding::kNone && !common_.only_decides(*task)) {
        grant.set_priority = true;
        if (tracked.moved && !exec::is_default_stream(tracked.stream))
            tracked.stream_priority =
                common_.streams.priorities().own(tracked.stream, tracked.flavor);
        grant.priority = priority_for(*task, launch, decision, grant.time);
        common_.observers.nvtx.priority(*task, grant.priority);
        common_.observers.records.priority(*task, grant.priority, common_.clock);
        task->facts.windows.launches_at(grant.priority);
    }
    common_.gate_keeper.knows_gpu(tracked.marks->resident_threads);
    find_room(launch, kernel, grant.time + grant.estimate);
    if (kernel.is_new) [[unlikely]]
        around_.syncs.first_launch_begins(*task, kernel);
    return grant;
}

// While looking on, too: scheduling may be switched on before the graph is launched.
std::optional<int> LaunchPath::replaceable_priority(CUgraph graph) const {
    if (common_.mode() == config::Mode::kOff || common_.scheduler.binding == config::Binding::kNone)
        return std::nullopt;
    const exec::RelaxedCaptureMode relaxed(common_.driver);
    return common_.streams.graphs().of_all_kernels(graph);
}

const exec::PriorityPool::Lane* LaunchPath::enter_pool(const Launch& launch, const Grant& grant) {
    // A launch that others depend on programmatically loses the overlap on another stream.
    // And one that must have ended when the call returns would be waited for on the wrong stream.
    if (grant.task->record.overlaps || common_.launches_block ||
        common_.marks.prepare() != grant.context)
        return nullptr;
    return common_.streams.pool().fork(*grant.context, grant.priority, launch.stream,
                                       launch.flavor);
}

void LaunchPath::after(ThreadState& thread, const Launch& launch, const Grant& grant,
                       bool succeeded) {
    if (grant.traced) [[unlikely]] {
        common_.tracer.launch_ended(
            thread, launch,
            succeeded
                ? common_.kernels.find(thread.kernels, thread.tracing.cursor, launch).name_hash
                : 0,
            grant.task, grant.time, succeeded);
    }
    if (succeeded) {
        ++thread.line.launches;
        thread.line.stream = launch.stream;
        thread.line.flavor = launch.flavor;
    }
    if (!grant.task) return;
    TaskState& task = *grant.task;
    if (succeeded) {
        bump(task.counters.launches);
        ++task.run.position;
    }
    if (succeeded && grant.scheduled && task.run.on_gpu) {
        bump(task.counters.scheduled);
        task.work.launched += grant.estimate;
        TaskSlot& slot = *task.slot;
        publish_head(task);
        slot.launched_ns.store(task.work.launched.count(), kRelaxed);
        slot.started.store(1, kRelaxed);
        // The launch itself may have taken long (a full queue), but then there is work in flight.
        const nanoseconds time(slot.look_ns.load(kRelaxed));
        slot.launch_ns.store(time.count(), kRelaxed);
        task.log.launched(grant.estimate, {.time = time,
                                           .kernel = grant.kernel,
                                           .position = task.run.position - 1,
                                           .instance = instance_tag(slot)});
        // Alone on the GPU, a mark can wait for the next launch, and is often never needed; unless
        // the next one will be on another stream, as this one was, or this one takes long by
        // itself.
        const bool now = !common_.follows_marks() || !common_.governor.company().is_alone() ||
                         task.tracked.moved || common_.marks_all() ||
                         grant.estimate >= common_.governor.ahead().mark_spacing.long_unit(task);
        around_.segments.launched(task, grant.estimate, time);
        if (!grant.may_be_timed) around_.segments.mark_branch(task, time);
        if (!grant.may_be_timed && now && around_.segments.mark_is_due(task, time) &&
            (!common_.follows_marks() || around_.segments.vouches(task)))
            around_.segments.mark_if_worth_it(task, time);
        if (!random_holds_.are_on() && task.gates.is_open)
            around_.planned.allow(thread, launch, grant);
    } else if (succeeded && task.run.observed) {
        around_.planned.allow_observed(thread, launch, grant);
    }
    around_.runs.release(thread);
}

void LaunchPath::hold_at_random(TaskState& task) {
    const nanoseconds time = random_holds_.next();
    if (time.count() == 0) return;
    bump(task.counters.holds);
    const FineTimerSlack slack;
    common_.clock.sleep_for(time);
}

// What the program asks for is a wish among its own launches: one level more urgent than the rest
// of its task, not before tasks that are more urgent by more than that.
int LaunchPath::priority_for(TaskState& task, const Launch& launch, const sched::Decision& decision,
                             nanoseconds now) {
    const int least = task.run.priority.least, greatest = task.run.priority.greatest;
    const bool is_vouched = !common_.follows_marks() || task.streams.graph.vouches();
    const sched::Levels may = common_.governor.levels(task, is_vouched, decision, now);
    const int asked = launch.asks_priority                     ? launch.priority
                      : exec::is_default_stream(launch.stream) ? 0
                                                               : task.tracked.stream_priority;
    const int priority = greatest + may.level;
    return asked < least ? std::max(priority - 1, greatest + may.first) : priority;
}

// --- asking

sched::Request LaunchPath::request_for(const TaskState& task) const {
    return {.enforces = common_.enforces(task),
            .is_seen = task.work.launched == task.work.marked || around_.segments.vouches(task)};
}

sched::Answer LaunchPath::ask(TaskState& task, nanoseconds now) {
    const sched::Answer answer = common_.governor.ask(task, request_for(task), now);
    if (answer.has_made_plan) common_.governor.plan().took(common_.clock.now() - now);
    if (answer.loan != sched::Loan::kNone) bump(task.counters.lent);
    if (task.learning) [[unlikely]]
        common_.progress.learn(task);
    return answer;
}

// --- holding

sched::Decision LaunchPath::hold_until_admitted(TaskState& task, bool may_stand_behind_gate,
                                                nanoseconds time) {
    if (random_holds_.are_on()) [[unlikely]]
        hold_at_random(task);
    if (!task.gates.is_open) [[unlikely]] {
        if (around_.gates.takes(task, time)) return task.gates.decision;
        if (!task.run.on_gpu) return task.gates.decision;  // a mark was refused
        time = common_.clock.now();
    }
    if (const auto decision = common_.governor.goes_as_before(task, time)) {
        if (common_.only_decides(task)) [[unlikely]]
            task.facts.would_hold.ends(time, common_.governor.hold_bound(task));
        return *decision;
    }
    sched::Answer answer = ask(task, time);
    if (common_.only_decides(task)) [[unlikely]]
        return would_hold(task, answer, time), answer.decision;
    if (!answer.wait) return answer.decision;
    if (may_stand_behind_gate && around_.gates.close(task, answer, time)) return answer.decision;

    const sched::GovernedRun& run = task.run;
    const auto make_visible = [&] {
        if (answer.wait->wants_mark && run.on_gpu && around_.segments.vouches(task))
            around_.segments.emit_mark(task, time);
    };
    make_visible();
    if (run.on_gpu && !common_.follows_marks()) around_.segments.wait_for_batches(task, 0);
    if (!run.on_gpu) return answer.decision;  // the mark was refused
    if (!answer.decision.admit) bump(task.counters.holds);
    set_state(task, abi::TaskState::kHeld);
    common_.observers.nvtx.wait_begins(task, *answer.wait, time);
    {
        const own_time::Held held;
        const FineTimerSlack slack;
        nanoseconds last = common_.clock.now();
        task.taking.held_frame = __builtin_frame_address(0);
        std::optional<nanoseconds> waits_for_turn_since;
        HoldPiece piece;
        while (answer.wait && common_.may_hold(task)) {
            const sched::Wait wait = *answer.wait;
            common_.observers.records.held(task, piece, wait, last);
            common_.governor.sleeps(task, wait);
            if (wait.why == sched::Why::kTurnToLaunch && !waits_for_turn_since)
                waits_for_turn_since = last;
            common_.clock.sleep_for(wait.sleep);
            time = common_.clock.now();
            common_.governor.slept(task, wait, time - last, time);
            common_.gate_keeper.slept(wait.sleep, time - last, time);
            count_wait(task, wait, time - last);
            if (!wait.is_paced) common_.observers.causes.held(task, wait.behind, time - last, time);
            last = time;
            answer = ask(task, time);
            if (answer.wait) make_visible();
            common_.governor.looked(task, answer, time, common_.clock.now());
            if (!run.on_gpu) break;  // the mark was refused
        }
        common_.observers.records.hold_ended(task, piece, time);
        task.taking.held_frame = nullptr;
        common_.observers.nvtx.wait_ends(task, time);
        common_.governor.queue().leaves(task.index);
        if (waits_for_turn_since) {
            common_.governor.estimates().waited_for_turn(task, answer.decision,
                                                         *waits_for_turn_since, time);
            note_launching(task);
        }
        if (!run.on_gpu) return answer.decision;
    }
    set_state(task, abi::TaskState::kGpu);
    return answer.decision;
}

// It goes all the same. What it says is of this moment: with real holds, others would be elsewhere.
void LaunchPath::would_hold(TaskState& task, const sched::Answer& answer, nanoseconds now) {
    common_.governor.queue().leaves(task.index);
    if (!answer.wait || answer.wait->is_paced)
        return task.facts.would_hold.ends(now, common_.governor.hold_bound(task));
    task.facts.would_hold.begins(now);
    if (answer.wait->behind < 0) return;
    // All tasks of the chain count here, each in its thread.
    const std::size_t behind = common_.roster.task(answer.wait->behind).chain->index;
    task.its_chain().would_wait_for[behind].fetch_add(1, kRelaxed);
}

void LaunchPath::count_wait(TaskState& task, const sched::Wait& wait, nanoseconds time) {
    TaskCounters& counters = task.counters;
    bump(wait.is_paced ? counters.paced_ns : counters.held_ns, std::int64_t{time.count()});
    if (!wait.is_paced && task.run.waited.held >= common_.governor.hold_bound(task))
        bump(counters.holds_opened);
}

}  // namespace urgengo::runtime
