// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/governed_subject.h"

#include <algorithm>
#include <utility>

#include "host/sched/instance_slot.h"

namespace urgengo::sim {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;

/// What it takes to look again, and to make a plan for ten chains.
constexpr nanoseconds kLook{1'000}, kPlan{5'000};

nanoseconds to_host(nanoseconds now) {
    return GovernedProgram::kStart + now;
}
nanoseconds to_sim(nanoseconds time) {
    return time - GovernedProgram::kStart;
}

}  // namespace

GovernedSubject::GovernedSubject(const config::Config& config, const config::Profile& profile,
                                 nanoseconds mark_late)
    : program_(config, profile),
      marks_(program_, mark_late),
      gates_(program_, marks_),
      owed_(config.chains.size()),
      held_(config.chains.size()),
      longest_hold_(config.chains.size()),
      threads_(config.chains.size()),
      waits_for_all_(config.chains.size()) {}

void GovernedSubject::bystander_launched(nanoseconds) {
    program_.governor.bystanders().launched();
}

void GovernedSubject::arrived(int chain, nanoseconds arrival, nanoseconds now) {
    marks_.deliver(to_host(now));
    held_[static_cast<std::size_t>(chain)] = nanoseconds{0};
    if (program_.has_hints(chain)) return program_.arrived(chain, to_host(arrival));
    thread(chain).woke = to_host(now);
}

bool GovernedSubject::exits(Place at, nanoseconds arrival, nanoseconds now) {
    return program_.has_hints(at.chain) &&
           program_.exits(task_at(at), to_host(arrival), to_host(now));
}

void GovernedSubject::task_begins(Place at, nanoseconds arrival, nanoseconds now) {
    if (program_.has_hints(at.chain)) program_.begin(task_at(at), to_host(arrival), to_host(now));
}

void GovernedSubject::begin_by_first_call(Place at, nanoseconds now) {
    Thread& its = thread(at.chain);
    SimTask& task = task_at(at);
    if (at.task == 0) {
        const nanoseconds cpu = now - its.woke;
        its.arrival = its.backlog.begin_frame(*task.chain, its.waited, cpu, now);
        program_.arrived(at.chain, its.arrival);
    }
    its.is_at_task = true;
    program_.begin(task, its.arrival, now);
}

// --- a launch

LaunchAnswer GovernedSubject::launch(Place at, nanoseconds time) {
    const nanoseconds now = to_host(time);
    marks_.deliver(now);
    SimTask& task = task_at(at);
    if (task.awaited_batch != 0) {
        marks_.batch_ended(task, now);
        return task.wait ? sleep(task, now) : decide(task, now);
    }
    if (task.gates.awaited)
        return go_behind_gates(task, gates_.look_again(task, now, owed(task)), now);
    if (task.wait) return look_again(task, now);
    if (!program_.has_hints(at.chain) && !thread(at.chain).is_at_task) begin_by_first_call(at, now);
    streams::follow(task, at.branch);
    sched::GovernedRun& run = task.run;
    if (!program_.governor.schedules() || run.observed) return {};
    if (!run.on_gpu) program_.enter_gpu_segment(task, now);
    const model::PlannedKernel& kernel = task.plan.at(at.kernel);
    run.next = kernel.gpu_time;
    task.slot->head_utilization_ppm.store(kernel.utilization_ppm, kRelaxed);
    // Of a move, only within an instance, to where all of it is joined.
    if (vouches(task) && (!task.has_moved || run.position > 0) && marks_.is_due(task, now))
        owed(task) += mark_if_worth_it(task, now);
    if (const auto tag = marks_.batch_to_wait_for(task, false, now)) return wait_for_batch(tag);
    return go_behind_gates(task, gates_.takes(task, now, owed(task)), now);
}

LaunchAnswer GovernedSubject::go_behind_gates(SimTask& task, GovernedGates::Taken taken,
                                              nanoseconds now) {
    switch (taken) {
        case GovernedGates::Taken::kGoes:
            return go(task, task.gates.decision, now);
        case GovernedGates::Taken::kSleeps:
            return {.goes = false, .look_at = to_sim(now + program_.scheduler().hold.poll)};
        case GovernedGates::Taken::kNot:
            break;
    }
    return decide(task, now);
}

LaunchAnswer GovernedSubject::decide(SimTask& task, nanoseconds now) {
    if (const auto decision = program_.governor.goes_as_before(task, now))
        return go(task, *decision, now);
    const sched::Answer answer = ask(task, now);
    if (!answer.wait || gates_.close(task, answer, now, owed(task)))
        return go(task, answer.decision, now);
    task.wait = answer.wait;
    make_visible(task, *answer.wait, now);
    if (const auto tag = marks_.batch_to_wait_for(task, true, now)) return wait_for_batch(tag);
    return sleep(task, now);
}

sched::Answer GovernedSubject::ask(SimTask& task, nanoseconds now) {
    sched::Governor& governor = program_.governor;
    const sched::Answer answer = governor.ask(task, program_.request_for(task), now);
    if (answer.has_made_plan) governor.plan().took(kPlan);
    return answer;
}

LaunchAnswer GovernedSubject::sleep(SimTask& task, nanoseconds now) {
    task.slot->state.store(abi::TaskState::kHeld, kRelaxed);
    program_.governor.sleeps(task, *task.wait);
    if (task.wait->why == sched::Why::kTurnToLaunch && !task.waits_for_turn_since)
        task.waits_for_turn_since = now;
    task.asleep_since = now;
    return {.goes = false, .look_at = to_sim(now + task.wait->sleep)};
}

LaunchAnswer GovernedSubject::look_again(SimTask& task, nanoseconds now) {
    sched::Governor& governor = program_.governor;
    governor.slept(task, *task.wait, now - task.asleep_since, now);
    sched::Answer answer = ask(task, now);
    if (answer.wait) make_visible(task, *answer.wait, now);
    governor.looked(task, answer, now, now + kLook);
    task.wait = answer.wait;
    if (answer.wait) return sleep(task, now);
    if (const auto since = std::exchange(task.waits_for_turn_since, std::nullopt))
        program_.governor.estimates().waited_for_turn(task, answer.decision, *since, now);
    task.slot->state.store(abi::TaskState::kGpu, kRelaxed);
    owed(task) += kLook;
    return go(task, answer.decision, now);
}

void GovernedSubject::make_visible(SimTask& task, const sched::Wait& wait, nanoseconds now) {
    if (wait.wants_mark && vouches(task)) owed(task) += gates_.mark(task, now);
}

LaunchAnswer GovernedSubject::wait_for_batch(std::int64_t tag) const {
    return {.goes = false, .until_mark = tag};
}

LaunchAnswer GovernedSubject::go(SimTask& task, const sched::Decision& decision, nanoseconds now) {
    LaunchAnswer answer;
    answer.cpu = std::exchange(owed(task), nanoseconds{0});
    const bool is_vouched = !program_.follows_marks() || task.graph.vouches();
    if (program_.scheduler().binding != config::Binding::kNone)
        answer.priority = task.run.priority.greatest +
                          program_.governor.levels(task, is_vouched, decision, now).level;
    return answer;
}

void GovernedSubject::launched(Place at, nanoseconds) {
    SimTask& task = task_at(at);
    streams::launched(task);
    ++task.run.position;
    if (!task.run.on_gpu) return;
    abi::TaskSlot& slot = *task.slot;
    task.work.launched += task.run.next;
    program_.publish_head(task);
    slot.launched_ns.store(task.work.launched.count(), kRelaxed);
    slot.started.store(1, kRelaxed);
    const nanoseconds asked(slot.look_ns.load(kRelaxed));
    slot.launch_ns.store(asked.count(), kRelaxed);
    sched::publish_unmarked(task, task.unmarked, !program_.follows_marks() || task.graph.vouches(),
                            program_.governor.company().is_alone(), asked);
    const bool at_once = task.has_moved || marks_.marks_at_once(task, task.run.next);
    if (at_once && marks_.is_due(task, asked) && (!program_.follows_marks() || vouches(task)))
        owed(task) += mark_if_worth_it(task, asked);
}

nanoseconds GovernedSubject::mark_if_worth_it(SimTask& task, nanoseconds now) {
    return program_.governor.looks_instead_of_mark(task, now) ? nanoseconds{0}
                                                              : gates_.mark(task, now);
}

// --- the wait for it

void GovernedSubject::joined(Place at, int branch, int other, nanoseconds) {
    streams::joined(task_at(at), branch, other);
}

void GovernedSubject::wait_begins(Place at, nanoseconds time) {
    SimTask& task = task_at(at);
    const nanoseconds now = to_host(time);
    const bool for_all = streams::covers_all(task, 0);
    waits_for_all_[task.chain->index] = for_all;
    task.slot->waits.store(1, kRelaxed);
    task.run.wait_begin = now;
    owed(task) = nanoseconds{0};
    if (!for_all || !task.run.on_gpu || task.work.launched == task.work.marked ||
        !program_.follows_marks() || program_.governor.company().is_alone())
        return;
    // What it waits for is all; on that stream it is vouched for.
    const int branch = std::exchange(task.branch, 0);
    gates_.mark(task, now, abi::MarkRanks::kForAll);
    task.branch = branch;
}

void GovernedSubject::task_ends(Place at, nanoseconds time) {
    SimTask& task = task_at(at);
    const nanoseconds now = to_host(time);
    marks_.deliver(now);
    if (!program_.has_hints(at.chain)) {
        if (!std::exchange(thread(at.chain).is_at_task, false)) return;
        thread(at.chain).waited = now;
    }
    task.slot->waits.store(0, kRelaxed);
    if (gates_.opener().are_on()) gates_.opener().segment_ended(task, now);
    nanoseconds& held = held_[task.chain->index];
    held += task.run.waited.held;
    nanoseconds& longest = longest_hold_[task.chain->index];
    longest = std::max(longest, held);
    streams::waited(task, 0);
    const bool idle = waits_for_all_[task.chain->index];
    program_.leave_gpu_segment(task, idle, now);
    if (idle) marks_.segment_ended(task, now);
    program_.end(task, now);
}

void GovernedSubject::frame_ended(int chain, nanoseconds latency, nanoseconds now) {
    if (!program_.has_hints(chain)) latency = to_host(now) - thread(chain).arrival;
    program_.finished(chain, latency, to_host(now));
}

void GovernedSubject::mark_ended(int, std::int64_t tag, nanoseconds now) {
    const GovernedMarks::Ended mark = marks_.ended(tag, to_host(now));
    gates_.opener().mark_ended(mark.task, mark.sequence, to_host(now));
}

void GovernedSubject::park_begins(nanoseconds now) {
    if (gates_.opener().are_on()) gates_.opener().park(to_host(now));
}

void GovernedSubject::park_ends(nanoseconds now) {
    if (gates_.opener().are_on()) gates_.opener().unpark(to_host(now));
}

void GovernedSubject::woken(int what, nanoseconds now) {
    gates_.opener().woken(what, to_host(now));
}

std::optional<GateCounts> GovernedSubject::gate_counts() const {
    if (!gates_.opener().are_on()) return std::nullopt;
    return gates_.opener().counts();
}

}  // namespace urgengo::sim
