// SPDX-License-Identifier: Apache-2.0
#include "host/sched/instance_slot.h"

#include <algorithm>
#include <utility>

#include "host/base/memory_orders.h"
#include "host/model/starvation.h"
#include "host/model/urgency.h"
#include "host/sched/criticality.h"

namespace urgengo::sched {
namespace {

nanoseconds later_cpu(const Tasks& tasks, const GovernedTask& task, std::size_t segment) {
    return task.record.cpu.after(segment) +
           sum_from(tasks, *task.chain, task.stage + 1, &EstimatedTimes::cpu_ns);
}

}  // namespace

nanoseconds sum_from(const Tasks& tasks, const GovernedChain& chain, std::size_t stage,
                     std::atomic<std::int64_t> EstimatedTimes::*time) {
    nanoseconds sum{0};
    for (; stage < chain.tasks.size(); ++stage)
        sum += nanoseconds((tasks[chain.tasks[stage]].estimated.*time).load(kRelaxed));
    return sum;
}

namespace {

// A reload may have changed them since the last instance: they are on lines that are hardly ever
// written.
void describe_terms(const GovernedChain& chain, abi::TaskSlot& slot) {
    const auto write = [](auto& to, auto value) {
        if (to.load(kRelaxed) != value) to.store(value, kRelaxed);
    };
    write(slot.period_ns, chain.period().count());
    write(slot.relative_deadline_ns, chain.deadline().count());
    write(slot.demotes, static_cast<std::uint16_t>(chain.on_late() == config::OnLate::kDemote));
}

}  // namespace

void describe_task(GovernedTask& task, std::uint32_t owner) {
    const GovernedChain& chain = *task.chain;
    abi::TaskSlot& slot = *task.slot;
    slot.owner = owner;
    describe_terms(chain, slot);
    slot.chain = static_cast<std::uint32_t>(chain.index);
    slot.mean_utilization_ppm = model::to_ppm(task.plan.mean_utilization());
    task.estimated.gpu_ns = task.plan.gpu_time().count();
    task.estimated.cpu_ns = task.record.cpu.total().count();
    task.estimated.idle_ns = task.record.learns ? 0 : task.plan.idle_from(0).count();
}

void describe_chain(const Tasks& tasks, GovernedTask& task) {
    const auto sum = [&](auto time) { return sum_from(tasks, *task.chain, 0, time).count(); };
    task.slot->chain_gpu_ns.store(sum(&EstimatedTimes::gpu_ns), kRelaxed);
    task.slot->chain_idle_ns.store(sum(&EstimatedTimes::idle_ns), kRelaxed);
    task.slot->chain_cpu_ns.store(sum(&EstimatedTimes::cpu_ns), kRelaxed);
}

void rank_chains(const Tasks& tasks) {
    std::vector<GovernedChain*> order = tasks.chains();
    std::stable_sort(order.begin(), order.end(), [](const auto* a, const auto* b) {
        return std::pair(a->deadline(), a->period()) < std::pair(b->deadline(), b->period());
    });
    for (std::size_t rank = 0; rank < order.size(); ++rank)
        for (const int index : order[rank]->tasks)
            tasks[index].slot->static_rank = static_cast<std::uint32_t>(rank);
}

void publish_head(const GovernedTask& task, nanoseconds remaining, nanoseconds idle) {
    task.slot->head_remaining_ns.store(remaining.count(), kRelaxed);
    task.slot->head_idle_ns.store(idle.count(), kRelaxed);
}

void begin_instance(const Tasks& tasks, GovernedTask& task, nanoseconds deadline,
                    nanoseconds remaining, nanoseconds idle, nanoseconds now) {
    const auto later = [&](auto time) {
        return sum_from(tasks, *task.chain, task.stage + 1, time).count();
    };
    abi::TaskSlot& slot = *task.slot;
    slot.version.fetch_add(1, std::memory_order_acq_rel);  // odd: being written
    slot.deadline_ns.store(deadline.count(), kRelaxed);
    slot.later_gpu_ns.store(later(&EstimatedTimes::gpu_ns), kRelaxed);
    slot.later_idle_ns.store(later(&EstimatedTimes::idle_ns), kRelaxed);
    slot.later_cpu_ns.store(later_cpu(tasks, task, 0).count(), kRelaxed);
    slot.cpu_until_ns.store((now + task.record.cpu.estimate(0)).count(), kRelaxed);
    describe_chain(tasks, task);
    describe_terms(*task.chain, slot);
    slot.criticality.store(criticality(*task.chain), kRelaxed);
    model::forget_starvation(slot);
    slot.instance.fetch_add(1, kRelaxed);
    publish_head(task, remaining, idle);
    slot.state.store(abi::TaskState::kCpu, kRelaxed);
    tasks.set_active(task, true);
    slot.version.fetch_add(1, std::memory_order_release);
}

void begin_segment(const Tasks& tasks, const GovernedTask& task, std::size_t segment,
                   nanoseconds begin) {
    abi::TaskSlot& slot = *task.slot;
    slot.version.fetch_add(1, std::memory_order_acq_rel);
    slot.later_cpu_ns.store(later_cpu(tasks, task, segment).count(), kRelaxed);
    slot.cpu_until_ns.store((begin + task.record.cpu.estimate(segment)).count(), kRelaxed);
    slot.version.fetch_add(1, std::memory_order_release);
}

// What is launched behind a join goes by time, too, up to the next mark: it tells of both at once.
void publish_unmarked(const GovernedTask& task, model::UnmarkedWork& unmarked, bool is_vouched,
                      bool is_alone, nanoseconds now) {
    std::atomic<std::int64_t>& word = task.slot->unmarked_until;
    if (is_vouched && word.load(kRelaxed) == 0) [[likely]]
        return;
    const std::uint32_t issued = task.slot->marks_issued.load(kRelaxed);
    if (!is_vouched || unmarked.is_last(issued)) {
        // As it really takes, while marks are by the plan.
        const auto really = [&](nanoseconds planned) {
            const auto planned_ns = static_cast<double>(planned.count());
            return nanoseconds(static_cast<std::int64_t>(task.record.factor.value() * planned_ns));
        };
        const nanoseconds open = task.work.launched - task.work.marked;
        // Until the mark before it was seen executed, another fork may be in that.
        const std::uint32_t done = task.slot->marks_done.load(kRelaxed);
        const nanoseconds executed =
            done == issued ? task.fork_executed.load(done) : nanoseconds{0};
        unmarked.launched(now, really(open), really(std::min(executed, open)),
                          is_alone || task.decision.decision.rank == 0, issued);
    } else if (unmarked.is_over(task.slot->marks_done.load(kRelaxed))) {
        unmarked = {};
    }
    word.store(unmarked.word(), kRelaxed);
}

nanoseconds sure_lateness(const Tasks& tasks, const GovernedTask& task, nanoseconds arrival,
                          nanoseconds now) {
    const auto rest = [&](auto time) { return sum_from(tasks, *task.chain, task.stage, time); };
    const nanoseconds gpu = rest(&EstimatedTimes::gpu_ns) + rest(&EstimatedTimes::idle_ns);
    return -model::laxity({arrival + task.chain->deadline(), gpu, rest(&EstimatedTimes::cpu_ns)},
                          now);
}

}  // namespace urgengo::sched
