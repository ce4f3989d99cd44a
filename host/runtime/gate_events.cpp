// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/gate_events.h"

#include <algorithm>

#include "host/base/memory_orders.h"

namespace urgengo::runtime {

GateEvents::GateEvents(abi::SharedPage& page, const Roster& roster, RunRecords& records,
                       Clock& clock)
    : page_(page), roster_(roster), records_(records), clock_(clock) {
    gpu_.opened.resize(roster.tasks().size());
    gpu_.looked_at = clock.now();
}

void GateEvents::Round::note(const abi::TaskSlot& slot) {
    const std::uint32_t opened = slot.gates_opened.load(kRelaxed);
    if (slot.gates_closed.load(kRelaxed) != opened && num_gated_ < gated_.size())
        gated_[num_gated_++] = {&slot, opened};
}

std::uint32_t GateEvents::Round::opened() const {
    std::uint32_t opened = 0;
    for (std::size_t i = 0; i < num_gated_; ++i) {
        const abi::TaskSlot& slot = *gated_[i].slot;
        // A store of the GPU's may have closed again what was open.
        const auto more = static_cast<std::int32_t>(slot.gates_opened.load() - gated_[i].opened);
        if (more > 0 && slot.gate_opened_ns.load(kRelaxed) == time_.count())
            opened += static_cast<std::uint32_t>(more);
    }
    return opened;
}

void GateEvents::round_ended(const Round& round, nanoseconds begin) {
    const std::uint32_t opened = round.opened();
    if (opened == 0) return;
    rounds_.fetch_add(1, kRelaxed);
    opened_.fetch_add(opened, kRelaxed);
    if (!records_.are_on()) return;
    const nanoseconds now = clock_.now();
    records_.opened_gates({.begin = begin, .took = now - begin, .opened = opened}, now);
}

void GateEvents::look_at_gpu(nanoseconds now) {
    if (!records_.are_on()) return;
    RunRecords::Rounds told{.begin = gpu_.looked_at, .rounds = 0, .by_gpu = true};
    gpu_.looked_at = now;
    for (const auto& task : roster_.tasks()) {
        std::uint32_t& before = gpu_.opened[static_cast<std::size_t>(task->index)];
        const std::uint32_t opened = task->slot->gates_opened_by_gpu.load(kRelaxed);
        told.opened += opened - before;  // counts wrap
        before = opened;
    }
    if (told.opened == 0) return;
    const std::uint32_t rounds = page_.dispatch.gpu_rounds.load(kRelaxed);
    const std::uint64_t rounds_us = page_.dispatch.gpu_round_us.load(kRelaxed);
    told.rounds = rounds - gpu_.rounds;
    told.took = std::chrono::microseconds(rounds_us - gpu_.rounds_us);
    gpu_.rounds = rounds;
    gpu_.rounds_us = rounds_us;
    records_.opened_gates(told, now);
}

void GateEvents::park_begins(const Opening& opening) {
    const std::int64_t took_ns = opening.took.count();
    park_.begin_ns.store(opening.begin.count(), kRelaxed);
    park_.opening_ns.store(took_ns, kRelaxed);
    park_.gated.store(opening.gated, kRelaxed);
    park_.has_gates.store(opening.has_gates, kRelaxed);
    park_.refused_before.store(refused_.load(kRelaxed), kRelaxed);
    if (!opening.has_gates) return;
    parks_.fetch_add(1, kRelaxed);
    opening_ns_.fetch_add(took_ns, kRelaxed);
    observe::raise_to(most_opening_ns_, took_ns);
}

RunRecords::Park GateEvents::read_park() const {
    return {.begin = nanoseconds(park_.begin_ns.load(kRelaxed)),
            .opening = nanoseconds(park_.opening_ns.load(kRelaxed)),
            .gated = park_.gated.load(kRelaxed),
            .refused = refused_.load(kRelaxed) - park_.refused_before.load(kRelaxed)};
}

bool GateEvents::park_ends() {
    std::atomic<std::uint32_t>& parked = page_.dispatch.parked;
    std::uint32_t calls = parked.load();
    RunRecords::Park its;
    nanoseconds now{0};
    bool is_told = false;
    do {
        if (calls != 1) continue;
        its = read_park();
        // Most parks find no gate, and keep no launch from one.
        is_told = park_.has_gates.load(kRelaxed) || its.refused != 0;
        if (is_told) now = clock_.now();  // before the next park may begin
    } while (!parked.compare_exchange_weak(calls, calls - 1));
    if (calls != 1) return false;
    if (!is_told) return true;
    const std::int64_t parked_ns = (now - its.begin).count();
    ended_parks_.fetch_add(1, kRelaxed);
    parked_ns_.fetch_add(parked_ns, kRelaxed);
    observe::raise_to(most_parked_ns_, parked_ns);
    records_.parked(its, now);
    return true;
}

void GateEvents::add_to(observe::GateStatistics& told) const {
    const auto us = [](std::int64_t ns) { return 1e-3 * static_cast<double>(ns); };
    const auto mean_us = [&](std::int64_t ns, std::uint64_t count) {
        return count == 0 ? 0 : us(ns) / static_cast<double>(count);
    };
    told.host_rounds = rounds_.load(kRelaxed);
    told.opened_by_host = opened_.load(kRelaxed);
    told.parks = parks_.load(kRelaxed);
    told.park_us = mean_us(opening_ns_.load(kRelaxed), told.parks);
    told.most_park_us = us(most_opening_ns_.load(kRelaxed));
    told.parked_us = mean_us(parked_ns_.load(kRelaxed), ended_parks_.load(kRelaxed));
    told.most_parked_us = us(most_parked_ns_.load(kRelaxed));
}

}  // namespace urgengo::runtime
