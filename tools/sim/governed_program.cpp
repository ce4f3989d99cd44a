// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/governed_program.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "host/config/progress_choice.h"
#include "host/sched/gpu_segment.h"
#include "host/sched/instance_slot.h"
#include "tools/sim/governed_streams.h"

namespace urgengo::sim {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
using sched::GovernedChain;
using sched::GovernedTask;

/// Of an H200.
constexpr int kGreatestPriority = -5;

std::vector<nanoseconds> periods_of(const config::Config& config) {
    std::vector<nanoseconds> periods;
    for (const config::Chain& chain : config.chains) periods.push_back(chain.period);
    return periods;
}

}  // namespace

GovernedProgram::GovernedProgram(const config::Config& config, const config::Profile& profile)
    : scheduler_(config::paced_by_tracking(config.scheduler)),
      guard_(periods_of(config)),
      governor(scheduler_, config.chains, config.mode, *page_, *this, kStart) {
    for (std::size_t i = 0; i < config.chains.size(); ++i) {
        GovernedChain& chain = *chains_.emplace_back(std::make_unique<GovernedChain>());
        chain.config = config.chains[i];
        chain.index = i;
        governor.tasks().add(chain);
        for (const config::TaskProfile& task : profile.chains[i].tasks) add_task(chain, task);
        for (const int index : chain.tasks) sched::describe_chain(governor.tasks(), task(index));
    }
    for (const auto& task : tasks_) task->views.reserve(tasks_.size());
    sched::rank_chains(governor.tasks());
    governor.plan().reckon_load();
    page_->num_tasks = static_cast<std::uint32_t>(tasks_.size());
}

void GovernedProgram::add_task(GovernedChain& chain, const config::TaskProfile& profile) {
    SimTask& task = *tasks_.emplace_back(std::make_unique<SimTask>());
    governor.tasks().add(task);
    task.index = static_cast<int>(tasks_.size()) - 1;
    task.chain = &chain;
    task.stage = chain.tasks.size();
    task.plan = model::TaskPlan(profile);
    task.record.cpu = model::CpuSegments(task.plan.cpu_segments());
    task.line = &task.mark_line;
    task.slot = &page_->tasks[task.index];
    sched::describe_task(task, 1);
    chain.tasks.push_back(task.index);
}

// --- frames

void GovernedProgram::arrived(int index, nanoseconds arrival) {
    GovernedChain& chain = *chains_[static_cast<std::size_t>(index)];
    chain.last_arrival_ns.store(arrival.count(), kRelaxed);
    chain.expectation.arrived(arrival, chain.config.period, governor.queue().waited_at());
    chain.bandwidth.arrived(arrival, chain.config.period);
    if (scheduler_.guard && governor.schedules())
        guard_.frame_began(chain.index, arrival, chain.config.deadline);
}

bool GovernedProgram::exits(SimTask& task, nanoseconds arrival, nanoseconds now) {
    GovernedChain& chain = *task.chain;
    if (chain.config.on_late != config::OnLate::kExit ||
        guard_.mode(chain.index) == sched::GuardMode::kObserve ||
        sched::sure_lateness(governor.tasks(), task, arrival, now).count() <= 0)
        return false;
    missed(chain);
    chain.expectation.launched(arrival, now);
    tell_guard(chain.index, sched::kExitedDeadlines * chain.config.deadline, now);
    return true;
}

void GovernedProgram::missed(GovernedChain& chain) {
    chain.misses_in_a_row.fetch_add(1, kRelaxed);
}

void GovernedProgram::finished(int index, nanoseconds latency, nanoseconds now) {
    GovernedChain& chain = *chains_[static_cast<std::size_t>(index)];
    chain.expectation.ended(now);
    if (latency > chain.config.deadline)
        missed(chain);
    else
        chain.misses_in_a_row.store(0, kRelaxed);
    tell_guard(chain.index, latency, now);
}

void GovernedProgram::tell_guard(std::size_t chain, nanoseconds latency, nanoseconds now) {
    if (!scheduler_.guard || !governor.schedules()) return;
    if (governor.aside().is_on()) {
        if (guard_.pause()) governor.tasks().changed();
        return;
    }
    bool changed = guard_.bystanders_are_busy(governor.bystanders().are_busy());
    guard_.nobody_is_held(governor.plan().launching_is_scarce());
    changed |= guard_.frame_ended(chain, latency, chains_[chain]->config.deadline, now);
    if (changed) governor.tasks().changed();
}

bool GovernedProgram::enforces(std::size_t chain) const {
    return guard_.mode(chain) == sched::GuardMode::kEnforce;
}

// --- a task's instances

void GovernedProgram::begin(SimTask& task, nanoseconds arrival, nanoseconds now) {
    GovernedChain& chain = *task.chain;
    std::construct_at(&task.run);
    streams::begin_run(task);
    task.run.priority.least = 0;
    task.run.priority.greatest = kGreatestPriority;
    task.arrival = arrival;
    const bool hinted = chain.config.arrival == config::ArrivalFrom::kHint;
    task.cpu_begin = hinted ? now : nanoseconds{0};  // else it begins with a launch
    task.slot->waits.store(0, kRelaxed);
    task.run.observed = chain.config.mode != config::Mode::kEnforce ||
                        guard_.mode(chain.index) == sched::GuardMode::kObserve ||
                        governor.stands_aside(now);
    if (task.run.observed) governor.company().unmarked_begins(now);
    task.is_unseen.store(task.run.observed, kRelaxed);
    if (task.run.observed || !hinted) chain.expectation.launched(arrival, now);

    const nanoseconds deadline = chain.bandwidth.served(arrival) + chain.config.deadline;
    sched::begin_instance(governor.tasks(), task, deadline, task.plan.remaining_from(0),
                          task.plan.idle_from(0), now);
}

void GovernedProgram::end(SimTask& task, nanoseconds now) {
    sched::GovernedRun& run = task.run;
    if (task.run.observed) governor.company().unmarked_ends();
    task.record.cpu.end_instance(0);
    task.estimated.cpu_ns.store(task.record.cpu.total().count(), kRelaxed);
    if (run.position == 0) run.estimate.is_measured = false;
    if (const auto contradicts = governor.estimates().instance_ended(task, now);
        contradicts && scheduler_.guard)
        guard_.estimates_contradict(task.chain->index, *contradicts);
    task.slot->state.store(abi::TaskState::kIdle, kRelaxed);
    governor.tasks().set_active(task, false);
}

void GovernedProgram::publish_head(SimTask& task) {
    const std::size_t position = task.run.position;
    sched::publish_head(task, task.plan.remaining_from(position), task.plan.idle_from(position));
}

// --- GPU segments

void GovernedProgram::enter_gpu_segment(SimTask& task, nanoseconds now) {
    sched::enter_gpu_segment(governor, task,
                             {.cpu_begin = std::exchange(task.cpu_begin, nanoseconds{0}),
                              .arrival = task.arrival,
                              .position = task.run.position},
                             now);
}

void GovernedProgram::leave_gpu_segment(SimTask& task, bool idle, nanoseconds now) {
    sched::GovernedRun& run = task.run;
    if (!run.on_gpu) return;
    sched::measure_gpu_segment(governor, task, idle, run.position, now);
    run.on_gpu = false;
    if (idle) {
        sched::all_executed(task);
        task.graph.all_executed(task.num_launches);
    }
    sched::set_state(task, abi::TaskState::kCpu);
    governor.leaves_gpu(task, now);
}

sched::Request GovernedProgram::request_for(const SimTask& task) const {
    return {.enforces = enforces(task.chain->index),
            .is_seen =
                task.work.launched == task.work.marked || streams::vouches(task, follows_marks())};
}

}  // namespace urgengo::sim
