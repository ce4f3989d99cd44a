// SPDX-License-Identifier: Apache-2.0
#include "host/sched/dispatch_round.h"

#include <algorithm>

#include "host/base/memory_orders.h"

namespace urgengo::sched {
namespace {

bool is_in(const std::atomic<std::uint64_t>* words, int task) {
    return (words[task / 64].load(kRelaxed) >> (task % 64) & 1) != 0;
}

Entrant read_entrant(abi::SharedPage& page, int task, const RoundSettings& settings,
                     nanoseconds now, const abi::DispatchState* gpu) {
    abi::TaskSlot& slot = page.tasks[task];
    const std::uint32_t version = load_shared(slot.version);
    TaskReading reading = model::load_slot(slot);
    const std::int64_t gate_by_ns = slot.gate_by_ns.load(kRelaxed);
    const std::int64_t run_ahead_ns = slot.run_ahead_ns.load(kRelaxed);
    const Standing standing{now, settings.lambda, is_in(page.dispatch.given_up, task),
                            is_in(page.dispatch.late_first, task)};
    const std::uint32_t issued = load_shared(slot.marks_issued);
    std::uint32_t done = load_shared(slot.marks_done);
    reading.last.progress_ns = load_shared(slot.progress_ns);
    if (gpu && gpu->marked[task] != 0 && model::is_later_mark(gpu->done[task], done)) {
        done = gpu->done[task];
        reading.last.progress_ns = now.count();  // the host has yet to see it
    }
    model::load_marks(reading, slot, issued, done);
    Entrant entrant =
        entrant_of(reading, task, settings, standing, is_in(page.dispatch.may_share, task),
                   load_group(slot, reading.gates.opened + 1), gate_by_ns, run_ahead_ns);
    if (reading.state == abi::TaskState::kIdle || version % 2 != 0 ||
        load_shared(slot.version) != version)
        entrant.contender.blocks = false;
    return entrant;
}

}  // namespace

void store_settings(abi::DispatchSettings& page, const config::Scheduler& scheduler) {
    page.policy.store(static_cast<std::uint32_t>(scheduler.policy), kRelaxed);
    page.lambda.store(scheduler.parameters.lambda, kRelaxed);
    page.urgent_percentile.store(scheduler.parameters.urgent_percentile, kRelaxed);
    const PackLimits limits = limits_of(scheduler.packing, {});
    page.pack_limit_ppm.store(limits.pack, kRelaxed);
    page.share_limit_ppm.store(limits.share, kRelaxed);
    page.share_slack_ns.store(limits.share_slack.count(), kRelaxed);
}

bool open_gate(abi::TaskSlot& slot, std::uint32_t gate, nanoseconds now) {
    std::uint32_t opened = slot.gates_opened.load(kRelaxed);
    while (static_cast<std::int32_t>(gate - opened) > 0) {
        slot.gate_opened_ns.store(now.count(), kRelaxed);
        if (slot.gates_opened.compare_exchange_weak(opened, gate, std::memory_order_acq_rel))
            return true;
    }
    return false;
}

HostRounds::HostRounds(abi::SharedPage& page) : page_(page) {
    ranked_.reserve(abi::kMaxTasks);
}

int HostRounds::run(nanoseconds now, const abi::DispatchState* gpu) {
    if (busy_.exchange(true, std::memory_order_acquire)) return closed_.load(kRelaxed);
    const RoundSettings settings = load_settings(page_.dispatch);
    ranked_.clear();
    int needing_all = 0;
    for (int word = 0; word < abi::kTaskWords; ++word)
        for (std::uint64_t bits = page_.active[word].load(kRelaxed); bits != 0; bits &= bits - 1) {
            const int task = 64 * word + __builtin_ctzll(bits);
            ranked_.push_back({read_entrant(page_, task, settings, now, gpu), &page_.tasks[task]});
            needing_all += ranked_.back().entrant.contender.needs_all;
        }
    std::stable_sort(ranked_.begin(), ranked_.end(), [](const Ranked& a, const Ranked& b) {
        return a.entrant.contender.is_before(b.entrant.contender);
    });
    Before before;
    int closed = 0, rank = 0;
    for (const Ranked& r : ranked_) {
        const Entrant& self = r.entrant;
        page_.ranked[r.entrant.contender.task].store(abi::RankedWord{self.laxity_ns, ++rank}.pack(),
                                                     kRelaxed);
        if (self.is_gated) {
            const std::uint32_t opened =
                opened_after(self, before, settings.limits, needing_all > self.contender.needs_all,
                             [&](std::uint32_t gate) { return load_group(*r.slot, gate); });
            if (opened != self.opened && open_gate(*r.slot, opened, now) && gpu)
                r.slot->gates_opened_by_gpu.fetch_add(1, kRelaxed);
            closed += static_cast<int>(self.closed - opened);
        }
        before = before + as_before(self.contender);
    }
    closed_.store(closed, kRelaxed);
    busy_.store(false, std::memory_order_release);
    return closed;
}

}  // namespace urgengo::sched
