// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/gate_opener.h"

#include <algorithm>
#include <utility>

#include "host/base/memory_orders.h"
#include "host/config/connections.h"
#include "host/config/dispatch_choice.h"
#include "host/exec/poller.h"
#include "host/sched/gate_groups.h"

namespace urgengo::sim {
namespace {

using config::DeviceDispatch;
using config::Dispatch;

/// From a store that opens a gate until the stream goes on; what is behind it follows after the
/// gap.
/// @source measured on an H200: until the host sees the gated kernel's own store 6.5 us by the
///         host, 11.7 by a kernel, with the gate in the host's memory. A kernel on an idle stream
///         is seen 6.3 us after its launch is begun, which takes 2.3 and is heard of after 2.2:
///         so 1.8 us of all of these are from the kernel's start on, and 1.5 are the gap before it.
constexpr nanoseconds kAfterHost{3'200}, kAfterGpu{8'400};
/// From the end of GPU work to when the thread that waits for it knows. @source H200 (world.cpp)
constexpr nanoseconds kEndSeen{3'200};
/// What a gate in the host's memory that is open already takes of its stream. @source the same
constexpr nanoseconds kOpenAlready{2'300};
/// Rounds with ten tasks. @source docs/measurements.md, "Gates" (H100)
constexpr nanoseconds kHostRound{1'000}, kGpuRound{12'000};
/// From the mark that wakes an arm until its round begins. @source as much as the release latency
/// of armed at 99 % (24.7 us, the same) is above a round and what is after it. At 50 % the host's
/// rounds were sooner there: the GPU opened 9 of 174 gates.
constexpr nanoseconds kArmWakes{2'700};
/// A lease looks again so late where no mark has ended meanwhile. @source device/dispatcher.cu
constexpr nanoseconds kLeaseRests{2'000};
/// Of a mark that ranks. @source the same
constexpr int kMostRounds = 4;

enum What : int { kThreadLooks, kSegmentSeen, kGpuRoundEnds };

nanoseconds to_sim(nanoseconds time) {
    return time - GovernedProgram::kStart;
}

// In the model sleeps end on time, so that `auto` never has a reason to close a gate.
Dispatch who_opens(const GovernedProgram& program) {
    const auto where =
        config::choose_dispatch(program.scheduler(), {},
                                static_cast<std::size_t>(program.num_tasks()), kConnections)
            .where;
    return where == Dispatch::kAuto ? Dispatch::kThread : where;
}

}  // namespace

GateOpener::GateOpener(GovernedProgram& program, GovernedMarks& marks)
    : program_(program),
      marks_(marks),
      opens_by_(who_opens(program)),
      device_(program.scheduler().dispatch.device),
      rounds_(program.page()),
      told_(static_cast<std::size_t>(program.num_tasks())),
      issued_(told_.size()) {
    if (are_on()) sched::store_settings(program.page().dispatch, program.scheduler());
}

// --- told by launching threads

bool GateOpener::begins() {
    if (is_parked()) {
        ++counts_.held_by_parks;
        return false;
    }
    if (gated_ >= port_->num_connections() - config::kUngatedConnections) {
        ++counts_.refused;
        return false;
    }
    ++gated_;
    return true;
}

void GateOpener::put(const SimTask& task, std::uint32_t gate, nanoseconds now) {
    port_->gate(static_cast<int>(task.chain->index), task.branch, task.index, gate, kOpenAlready);
    ++counts_.closed;
    if (!std::exchange(thread_looks_, true)) port_->wake_subject(to_sim(now), kThreadLooks, true);
}

void GateOpener::ends(SimTask& task, nanoseconds now) {
    SimTask::Gates& gates = task.gates;
    if (std::exchange(gates.is_open, true)) return;
    --gated_;
    if (sched::open_gate(*task.slot, task.slot->gates_closed.load(kRelaxed), now))
        tell(kAfterHost, now);
    const nanoseconds waited = sched::waited_behind_gates(*task.slot, gates.since, now);
    (gates.is_hold ? task.run.waited.held : task.run.waited.paced) += waited;
    program_.governor.queue().leaves(task.index);
}

void GateOpener::changed(nanoseconds now) {
    if (gated_ > 0) run_host_round(now);
}

void GateOpener::segment_ended(SimTask& task, nanoseconds now) {
    ends(task, now);
    if (gated_ > 0) port_->wake_subject(to_sim(now + kEndSeen), kSegmentSeen, false);
}

void GateOpener::park(nanoseconds now) {
    program_.page().dispatch.parked.fetch_add(1);
    parked_since_ = now;
    ++counts_.parks;
    for (int i = 0; i < program_.num_tasks(); ++i) {
        abi::TaskSlot& slot = *program_.task(i).slot;
        counts_.opened_by_parks += sched::open_gate(slot, slot.gates_closed.load(kRelaxed), now);
    }
    tell(kAfterHost, now);
}

void GateOpener::unpark(nanoseconds now) {
    program_.page().dispatch.parked.fetch_sub(1);
    const nanoseconds its = now - parked_since_;
    counts_.parked += its;
    counts_.longest_park = std::max(counts_.longest_park, its);
}

// --- the host

void GateOpener::woken(int what, nanoseconds now) {
    switch (what) {
        case kThreadLooks:
            return look(now);
        case kSegmentSeen:
            return changed(now);
        case kGpuRoundEnds:
            return gpu_round_ends(now);
    }
}

void GateOpener::look(nanoseconds now) {
    // Launches behind gates ask for no plan.
    program_.governor.plan().refresh(now);
    open_overdue(now);
    thread_looks_ = run_host_round(now) > 0;
    if (!thread_looks_) return;
    const auto more = opens_by_ == Dispatch::kHost ? exec::More::kSoon : exec::More::kLater;
    port_->wake_subject(to_sim(now + exec::rest_after(more)), kThreadLooks, true);
}

// A round goes by what has been seen of marks.
int GateOpener::run_host_round(nanoseconds now) {
    marks_.deliver(now);
    const sched::Tasks& tasks = program_.governor.tasks();
    tasks.for_each_active([&](sched::GovernedTask& task) {
        if (sched::may_be_on_gpu(task)) tasks.look(task, now);
    });
    const int closed = rounds_.run(now);
    tell(kHostRound + kAfterHost, now);
    return closed;
}

void GateOpener::open_overdue(nanoseconds now) {
    const model::TaskSet active = model::TaskSet::read_from(program_.page().active);
    for (int i = 0; i < program_.num_tasks(); ++i) {
        abi::TaskSlot& slot = *program_.task(i).slot;
        if (!active.contains(i) || now.count() >= slot.gate_by_ns.load(kRelaxed))
            sched::open_gate(slot, slot.gates_closed.load(kRelaxed), now);
    }
    tell(kAfterHost, now);
}

/// Streams that wait, of what is open now.
void GateOpener::tell(nanoseconds late, nanoseconds now) {
    for (int i = 0; i < program_.num_tasks(); ++i) {
        const abi::TaskSlot& slot = *program_.task(i).slot;
        const std::uint32_t opened = slot.gates_opened.load(kRelaxed);
        if (std::exchange(told_[static_cast<std::size_t>(i)], opened) == opened) continue;
        if (now.count() >= slot.gate_by_ns.load(kRelaxed)) ++counts_.at_bound;
        port_->open(i, opened, late);
    }
}

// --- the GPU

void GateOpener::mark_issued(const SimTask& task, abi::MarkRanks ranks) {
    if (opens_by_ != Dispatch::kDevice) return;
    const std::uint32_t sequence = task.slot->marks_issued.load(kRelaxed);
    issued_[static_cast<std::size_t>(task.index)][sequence % abi::kMarkRing] = {
        task.slot->gates_closed.load(kRelaxed), ranks};
    // What is behind such a mark waits for its rounds, if it runs any.
    if (device_ == DeviceDispatch::kPiggyback && ranks != abi::MarkRanks::kNever)
        port_->gate(static_cast<int>(task.chain->index), task.branch, round_word(task), sequence,
                    nanoseconds{0});
}

void GateOpener::mark_ended(const SimTask& task, std::uint32_t sequence, nanoseconds now) {
    if (opens_by_ != Dispatch::kDevice) return;
    const IssuedMark& mark =
        issued_[static_cast<std::size_t>(task.index)][sequence % abi::kMarkRing];
    gpu_->done[task.index] = sequence;
    gpu_->reached[task.index] = mark.gate;
    gpu_->marked[task.index] = 1;
    const bool is_leased = device_ == DeviceDispatch::kLeased;
    const bool is_there = device_ == DeviceDispatch::kPiggyback || !is_parked();
    const bool ranks = is_there && (is_leased ? any_closed() : is_due(task, mark.ranks));
    const bool is_free = gpu_->busy == 0;
    if (ranks) {
        gpu_->again = 1;
        if (is_free) begin_gpu_round(device_ == DeviceDispatch::kArmed ? now + kArmWakes : now);
    }
    if (device_ != DeviceDispatch::kPiggyback || mark.ranks == abi::MarkRanks::kNever) return;
    if (ranks && is_free)
        ranking_ = {task.index, sequence, 0};
    else
        port_->open(round_word(task), sequence, nanoseconds{0});
}

bool GateOpener::is_closed(int task) const {
    return gpu_->reached[task] != gpu_->opened[task];
}

bool GateOpener::any_closed() const {
    for (int i = 0; i < program_.num_tasks(); ++i)
        if (is_closed(i)) return true;
    return false;
}

// A mark that ranks for itself asks the host's memory, one that wakes an arm the GPU's own.
bool GateOpener::is_due(const SimTask& task, abi::MarkRanks ranks) const {
    if (ranks != abi::MarkRanks::kForItself)
        return ranks == abi::MarkRanks::kForAll && any_closed();
    return device_ == DeviceDispatch::kPiggyback
               ? task.slot->gates_opened.load(kRelaxed) != gpu_->reached[task.index]
               : is_closed(task.index);
}

void GateOpener::begin_gpu_round(nanoseconds from) {
    gpu_->busy = 1;
    gpu_->again = 0;
    port_->wake_subject(to_sim(from + kGpuRound), kGpuRoundEnds, false);
}

void GateOpener::gpu_round_ends(nanoseconds now) {
    ++gpu_->rounds;
    gpu_->busy = 0;
    rounds_.run(now, gpu_.get());
    for (int i = 0; i < program_.num_tasks(); ++i)
        gpu_->opened[i] = program_.task(i).slot->gates_opened.load(kRelaxed);
    tell(kAfterGpu, now);
    const bool again = gpu_->again != 0;
    if (is_parked() && device_ != DeviceDispatch::kPiggyback) return;
    switch (device_) {
        case DeviceDispatch::kLeased:
            if (any_closed()) begin_gpu_round(again ? now : now + kLeaseRests);
            return;
        case DeviceDispatch::kArmed:
            if (again) begin_gpu_round(now + kArmWakes);
            return;
        case DeviceDispatch::kPiggyback:
            if (again && ++ranking_.rounds < kMostRounds) return begin_gpu_round(now);
            port_->open(round_word(program_.task(ranking_.task)), ranking_.sequence,
                        nanoseconds{0});
            return;
    }
}

GateCounts GateOpener::counts() const {
    GateCounts counts = counts_;
    counts.gpu_rounds = gpu_->rounds;
    for (int i = 0; i < program_.num_tasks(); ++i)
        counts.opened_by_gpu += program_.task(i).slot->gates_opened_by_gpu.load(kRelaxed);
    return counts;
}

}  // namespace urgengo::sim
