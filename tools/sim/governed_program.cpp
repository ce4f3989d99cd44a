// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/governed_program.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "host/model/starvation.h"
#include "host/model/urgency.h"
#include "host/sched/criticality.h"

namespace urgengo::sim {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
using sched::GovernedChain;
using sched::GovernedTask;

// As the runtime has them (instances.cpp, estimates.cpp, gpu_segment.cpp).
constexpr int kExitedDeadlines = 2;
constexpr double kReckonBeyond = 0.05;
constexpr double kContradicts = 1.25;
constexpr int kRetryAfter = 8;
constexpr int kShareOfDelay = 4;
/// Of an H200.
constexpr int kGreatestPriority = -5;

/// A program whose launches wait for their batches is not paced (runtime.cpp).
config::Scheduler paced_by_tracking(config::Scheduler scheduler) {
    if (scheduler.tracking != config::Tracking::kProgress)
        scheduler.run_ahead = std::chrono::hours(1);
    return scheduler;
}

std::vector<nanoseconds> periods_of(const config::Config& config) {
    std::vector<nanoseconds> periods;
    for (const config::Chain& chain : config.chains) periods.push_back(chain.period);
    return periods;
}

}  // namespace

GovernedProgram::GovernedProgram(const config::Config& config, const config::Profile& profile)
    : scheduler_(paced_by_tracking(config.scheduler)),
      guard_(periods_of(config)),
      governor(scheduler_, config.chains, config.mode, *page_, *this, kStart) {
    for (std::size_t i = 0; i < config.chains.size(); ++i) {
        GovernedChain& chain = *chains_.emplace_back(std::make_unique<GovernedChain>());
        chain.config = config.chains[i];
        chain.index = i;
        governor.tasks().add(chain);
        for (const config::TaskProfile& task : profile.chains[i].tasks) add_task(chain, task);
        for (const int index : chain.tasks) describe_chain(task(index));
    }
    for (const auto& task : tasks_) task->views.reserve(tasks_.size());
    rank_chains();
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
    task.cpu = model::CpuSegments(task.plan.cpu_segments());
    task.has_plan = true;
    task.line = &task.mark_line;
    task.slot = &page_->tasks[task.index];
    abi::TaskSlot& slot = *task.slot;
    slot.owner = 1;
    slot.period_ns = chain.config.period.count();
    slot.relative_deadline_ns = chain.config.deadline.count();
    slot.demotes = chain.config.on_late == config::OnLate::kDemote;
    slot.chain = static_cast<std::uint32_t>(chain.index);
    slot.mean_utilization_ppm = model::to_ppm(task.plan.mean_utilization());
    task.gpu_time_ns = task.plan.gpu_time().count();
    task.cpu_time_ns = task.cpu.total().count();
    task.idle_time_ns = task.plan.idle_from(0).count();
    chain.tasks.push_back(task.index);
}

// The tighter the deadline, the sooner; then the shorter the period.
void GovernedProgram::rank_chains() {
    std::vector<const GovernedChain*> order;
    for (const auto& chain : chains_) order.push_back(chain.get());
    std::stable_sort(order.begin(), order.end(), [](const auto* a, const auto* b) {
        return std::pair(a->config.deadline, a->config.period) <
               std::pair(b->config.deadline, b->config.period);
    });
    for (std::size_t rank = 0; rank < order.size(); ++rank)
        for (const int index : order[rank]->tasks)
            task(index).slot->static_rank = static_cast<std::uint32_t>(rank);
}

nanoseconds GovernedProgram::sum_from(const GovernedChain& chain, std::size_t stage,
                                      std::atomic<std::int64_t> GovernedTask::*time) const {
    nanoseconds sum{0};
    for (; stage < chain.tasks.size(); ++stage)
        sum += nanoseconds((task(chain.tasks[stage]).*time).load(kRelaxed));
    return sum;
}

void GovernedProgram::describe_chain(SimTask& task) {
    const GovernedChain& chain = *task.chain;
    task.slot->chain_gpu_ns = sum_from(chain, 0, &GovernedTask::gpu_time_ns).count();
    task.slot->chain_idle_ns = sum_from(chain, 0, &GovernedTask::idle_time_ns).count();
    task.slot->chain_cpu_ns = sum_from(chain, 0, &GovernedTask::cpu_time_ns).count();
}

// --- frames

void GovernedProgram::arrived(int index, nanoseconds arrival) {
    GovernedChain& chain = *chains_[static_cast<std::size_t>(index)];
    chain.last_arrival_ns.store(arrival.count(), kRelaxed);
    chain.expectation.arrived(arrival, chain.config.period, governor.waited_at());
    chain.bandwidth.arrived(arrival, chain.config.period);
    if (scheduler_.guard && governor.schedules())
        guard_.frame_began(chain.index, arrival, chain.config.deadline);
}

bool GovernedProgram::exits(SimTask& task, nanoseconds arrival, nanoseconds now) {
    GovernedChain& chain = *task.chain;
    const nanoseconds lax =
        model::laxity({arrival + chain.config.deadline,
                       sum_from(chain, task.stage, &GovernedTask::gpu_time_ns) +
                           sum_from(chain, task.stage, &GovernedTask::idle_time_ns),
                       sum_from(chain, task.stage, &GovernedTask::cpu_time_ns)},
                      now);
    if (lax.count() >= 0 || chain.config.on_late != config::OnLate::kExit || !enforces(chain.index))
        return false;
    missed(chain);
    chain.expectation.launched(arrival, now);
    tell_guard(chain.index, kExitedDeadlines * chain.config.deadline, now);
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
    if (!guard_.frame_ended(chain, latency, chains_[chain]->config.deadline, now)) return;
    governor.plan().is_needed();
    governor.tasks().changed();
}

bool GovernedProgram::enforces(std::size_t chain) const {
    return guard_.mode(chain) == sched::GuardMode::kEnforce;
}

// --- a task's instances

void GovernedProgram::begin(SimTask& task, nanoseconds arrival, nanoseconds now) {
    GovernedChain& chain = *task.chain;
    std::construct_at(&task.run);
    task.run.least_priority = 0;
    task.run.greatest_priority = kGreatestPriority;
    task.arrival = arrival;
    task.cpu_begin = now;
    task.waits.store(false, kRelaxed);
    task.run.observed = guard_.mode(chain.index) == sched::GuardMode::kObserve;
    if (task.run.observed) governor.company().unmarked_begins(now);
    task.is_unseen.store(task.run.observed, kRelaxed);
    if (task.run.observed) chain.expectation.launched(arrival, now);

    abi::TaskSlot& slot = *task.slot;
    const nanoseconds served = chain.bandwidth.served(arrival);
    const std::size_t next = task.stage + 1;
    slot.deadline_ns = (served + chain.config.deadline).count();
    slot.later_gpu_ns = sum_from(chain, next, &GovernedTask::gpu_time_ns).count();
    slot.later_idle_ns = sum_from(chain, next, &GovernedTask::idle_time_ns).count();
    slot.later_cpu_ns =
        (task.cpu.after(0) + sum_from(chain, next, &GovernedTask::cpu_time_ns)).count();
    slot.cpu_until_ns = (now + task.cpu.estimate(0)).count();
    describe_chain(task);
    slot.criticality = sched::criticality(chain);
    model::forget_starvation(slot);
    slot.instance.fetch_add(1, kRelaxed);
    publish_head(task);
    slot.state.store(abi::TaskState::kCpu, kRelaxed);
    page_->active[model::TaskSet::word_of(task.index)].fetch_or(model::TaskSet::bit_of(task.index),
                                                                kRelaxed);
    slot.version.fetch_add(2, kRelaxed);
    governor.plan().is_needed();
}

void GovernedProgram::end(SimTask& task, nanoseconds now) {
    if (task.run.observed) governor.company().unmarked_ends();
    task.cpu.end_instance(0);
    task.cpu_time_ns.store(task.cpu.total().count(), kRelaxed);
    correct_estimates(task, now);
    task.slot->state.store(abi::TaskState::kIdle, kRelaxed);
    page_->active[model::TaskSet::word_of(task.index)].fetch_and(
        ~model::TaskSet::bit_of(task.index), kRelaxed);
}

void GovernedProgram::publish_head(SimTask& task) {
    const std::size_t position = task.run.position;
    task.slot->head_remaining_ns.store(task.plan.remaining_from(position).count(), kRelaxed);
    task.slot->head_idle_ns.store(task.plan.idle_from(position).count(), kRelaxed);
}

// --- GPU segments

void GovernedProgram::enter_gpu_segment(SimTask& task, nanoseconds now) {
    sched::GovernedRun& run = task.run;
    abi::TaskSlot& slot = *task.slot;
    run.position_at_mark[slot.marks_issued.load(kRelaxed) % abi::kMarkRing] = run.position;
    const nanoseconds took = now - task.cpu_begin;
    task.cpu_jitter.saw(took - task.cpu.estimate(0), kShareOfDelay);
    task.cpu.observe(0, took);
    if (task.stage == 0) task.chain->expectation.launched(task.arrival, now);
    task.cpu_begin = nanoseconds{0};
    run.marked_at = now;
    run.waited_at_mark = run.paced + run.held;
    slot.look_ns.store(now.count(), kRelaxed);
    slot.progress_ns.store(now.count(), kRelaxed);
    slot.started.store(0, kRelaxed);
    slot.state.store(abi::TaskState::kGpu, kRelaxed);
    governor.comes_to_gpu(task, task.plan.remaining_from(run.position).count() != 0, now);
    run.on_gpu = true;
    run.segment = {.time = now,
                   .held_idle = run.held_idle,
                   .held = run.held + run.paced,
                   .launched = task.launched,
                   .position = run.position,
                   .alone = governor.company().is_alone()};
    run.wait_begin = nanoseconds{0};
}

void GovernedProgram::leave_gpu_segment(SimTask& task, nanoseconds now) {
    sched::GovernedRun& run = task.run;
    if (!run.on_gpu) return;
    measure_ended(task, now);
    run.on_gpu = false;
    abi::TaskSlot& slot = *task.slot;
    const std::uint32_t issued = slot.marks_issued.load(kRelaxed);
    slot.launched_at_mark_ns[issued % abi::kMarkRing].store(task.launched.count(), kRelaxed);
    run.position_at_mark[issued % abi::kMarkRing] = run.position;
    slot.marks_done.store(issued, kRelaxed);
    task.marked = task.launched;
    slot.state.store(abi::TaskState::kCpu, kRelaxed);
    governor.leaves_gpu(task, true, now);
}

sched::Request GovernedProgram::request_for(const SimTask& task) const {
    return {.enforces = enforces(task.chain->index),
            .is_seen = true,
            .knows_rest = task.plan.remaining_from(task.run.position).count() != 0};
}

// --- estimates

void GovernedProgram::measure_ended(SimTask& task, nanoseconds now) {
    sched::GovernedRun& run = task.run;
    const sched::GovernedRun::SegmentBegin& begin = run.segment;
    model::EstimateFactor::Instance& sum = run.measured;
    const bool alone = begin.alone && governor.company().was_alone_since(begin.time);
    sum.alone = alone && (sum.alone || sum.estimated.count() == 0);
    run.beside_bystanders |= governor.are_bystanders_there(now);
    sum.estimated += task.launched - begin.launched;
    sum.most += now - begin.time - (run.held_idle - begin.held_idle);
    const nanoseconds held = run.held + run.paced - begin.held;
    sum.waited += held - (run.held_idle - begin.held_idle);
    sum.least += now - run.wait_begin;
    sum.waited += now - run.wait_begin;
    run.launching.took += run.wait_begin - begin.time - held;
    run.launching.alone +=
        std::max(task.plan.launch_time(run.position) - task.plan.launch_time(begin.position + 1),
                 nanoseconds{0});
}

void GovernedProgram::correct_estimates(SimTask& task, nanoseconds now) {
    sched::GovernedRun& run = task.run;
    if (run.observed) return;
    const bool was_given_up = governor.plan().gives_up(task);
    task.given_up_in_a_row = was_given_up ? task.given_up_in_a_row + 1 : 0;
    const bool retries = task.given_up_in_a_row >= kRetryAfter;
    if (retries) task.given_up_in_a_row = 0;
    const bool is_supported = task.factor.instances() == 0 || task.factor.is_supported();
    if (is_supported && task.slot->instance.load(kRelaxed) >= model::EstimateFactor::kRecent)
        task.slot->is_supported.store(!retries, kRelaxed);
    if (run.position == 0) return;
    if (run.beside_bystanders) {
        const double expected =
            task.factor.value() * static_cast<double>(run.measured.estimated.count()) +
            static_cast<double>(task.idle_time_ns.load(kRelaxed));
        if (run.measured.alone && task.factor.is_supported() && expected > 0 &&
            !sched::is_launch_bound(task))
            governor.bystanders().measured(
                run.measured.most, nanoseconds(static_cast<std::int64_t>(expected)), run.position);
        run.measured.alone = false;
    }
    task.factor.observe(run.measured);
    const double factor = task.factor.value();
    task.slot->factor_ppm.store(model::to_ppm(factor), kRelaxed);
    const bool contradicts = factor > kContradicts || factor * kContradicts < 1;
    if (scheduler_.guard) guard_.estimates_contradict(task.chain->index, contradicts);
    task.gpu_time_ns.store(
        static_cast<std::int64_t>(factor * static_cast<double>(task.plan.gpu_time().count())),
        kRelaxed);
    if (run.measured.alone && run.launching.marks == 0) run.launching.marks = 1;
    task.contention.observe(run.launching, now);
    const double pace = task.contention.pace();
    if (std::abs(factor / task.reckoned_factor - 1) > kReckonBeyond ||
        std::abs(pace / task.reckoned_pace - 1) > kReckonBeyond) {
        task.plan.reckon_idle(factor, pace);
        task.reckoned_factor = factor;
        task.reckoned_pace = pace;
        task.idle_time_ns.store(task.plan.idle_from(0).count(), kRelaxed);
        governor.plan().reckon_load();
    }
    publish_contention(task);
}

void GovernedProgram::publish_contention(SimTask& task) {
    const model::Launching verdict = task.contention.verdict();
    if (task.slot->launching.load(kRelaxed) == verdict) return;
    task.slot->launching.store(verdict, kRelaxed);
    governor.plan().reckon_load();
}

void GovernedProgram::waited_to_launch(SimTask& task, const sched::Decision& decision,
                                       nanoseconds now) {
    task.slot->waits_to_launch.store(0, kRelaxed);
    if (!decision.launches_late && decision.rank != abi::kMaxTasks)
        task.contention.held(decision.others_pause, now);
    publish_contention(task);
}

int GovernedProgram::num_others_launching(const SimTask& task, nanoseconds now) const {
    if (governor.company().is_alone() || scheduler_.launchers == 0) return 0;
    int count = 0;
    governor.tasks().for_each_active([&](const GovernedTask& other) {
        count += &other != &task && model::is_launching(*other.slot, now) &&
                 other.slot->launching.load(kRelaxed) != model::Launching::kFree;
    });
    return count;
}

}  // namespace urgengo::sim
