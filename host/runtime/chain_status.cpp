// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/chain_status.h"

#include <algorithm>
#include <limits>

#include "host/base/memory_orders.h"
#include "host/base/own_log.h"

namespace urgengo::runtime {
namespace {

std::uint32_t to_us(nanoseconds time) {
    constexpr std::int64_t kMost = std::numeric_limits<std::uint32_t>::max();
    return static_cast<std::uint32_t>(std::clamp<std::int64_t>(time.count() / 1000, 0, kMost));
}

template <typename T>
void raise(std::atomic<T>& to, const std::atomic<T>& from) {
    observe::raise_to(to, from.load(kRelaxed));
}

void count_misses(const ChainState& chain, abi::ChainStatus& status) {
    const observe::ChainStatistics& s = chain.statistics;
    raise(status.missed, s.frames.missed);
    status.misses_in_a_row.store(static_cast<std::uint32_t>(chain.misses_in_a_row.load(kRelaxed)),
                                 kRelaxed);
    observe::raise_to(status.most_misses_in_a_row,
                      static_cast<std::uint32_t>(s.frames.most_misses_in_a_row.load(kRelaxed)));
}

}  // namespace

void ChainStatus::note_miss(const ChainState& chain, std::uint64_t number, nanoseconds latency,
                            const observe::Cause& cause) const {
    const auto to_ms = [](nanoseconds time) { return 1e-6 * static_cast<double>(time.count()); };
    const auto& chains = common_.roster.chains();
    const auto behind = static_cast<std::size_t>(cause.behind);
    note(LogDetail::kDebug, "frame {} of '{}' missed, {:.2f} ms late: {} ({:.2f} ms)", number,
         chain.config.name, to_ms(latency - chain.deadline()),
         observe::in_words(cause.kind, behind < chains.size() ? chains[behind]->config.name : "",
                           cause.detail),
         to_ms(cause.amount));
}

ChainStatus::ChainStatus(Common& common)
    : common_(common), records_(common.roster.chains().size()) {
    for (const auto& task : common.roster.tasks()) {
        abi::TaskStatus& status = common.status.task(static_cast<std::size_t>(task->index));
        status.num_kernels = static_cast<std::uint32_t>(task->plan.num_kernels());
        status.planned_gpu_ns = task->plan.gpu_time().count();
        status.planned_cpu_ns = task->record.cpu.total().count();
    }
}

void ChainStatus::arrived(const ChainState& chain) {
    abi::ChainStatus& status = common_.status.chain(chain.index);
    observe::raise_to(status.instances, chain.statistics.frames.instances.load(kRelaxed));
    status.late_starts.store(
        static_cast<std::uint32_t>(chain.statistics.frames.late_starts.load(kRelaxed)), kRelaxed);
    status.last_arrival_ns.store(chain.last_arrival_ns.load(kRelaxed), kRelaxed);
}

// An older value never comes after a newer one where that can be told: what grows is raised.
void ChainStatus::count(const ChainState& chain, abi::ChainStatus& status) const {
    const observe::ChainStatistics& s = chain.statistics;
    count_misses(chain, status);
    observe::raise_to(common_.status.header().looks_ns, common_.governor.polls().total().count());
    raise(status.finished, s.frames.finished);
    raise(status.exited, s.frames.exited);
    raise(status.latency_sum_ns, s.frames.latency_sum_ns);
    raise(status.latency_max_ns, s.frames.latency_max_ns);
    status.guard.store(static_cast<std::uint32_t>(common_.guard.mode(chain.index)), kRelaxed);

    std::uint64_t launches = 0, scheduled = 0, marks = 0, holds = 0, would_hold = 0;
    std::int64_t held_ns = 0, paced_ns = 0, would_held_ns = 0;
    for (const int index : chain.tasks) {
        const TaskState& task = common_.roster.task(index);
        const TaskCounters& counters = task.counters;
        launches += counters.launches.load(kRelaxed) + task.unasked.uncounted(*task.slot);
        scheduled += counters.scheduled.load(kRelaxed) + task.uncounted_scheduled();
        marks += counters.marks.load(kRelaxed);
        holds += counters.holds.load(kRelaxed);
        held_ns += counters.held_ns.load(kRelaxed);
        paced_ns += counters.paced_ns.load(kRelaxed);
        would_hold += task.facts.would_hold.launches.load(kRelaxed);
        would_held_ns += task.facts.would_hold.ns.load(kRelaxed);
    }
    observe::raise_to(status.launches, launches);
    observe::raise_to(status.scheduled, scheduled);
    observe::raise_to(status.marks, marks);
    observe::raise_to(status.holds, holds);
    observe::raise_to(status.held_ns, held_ns);
    observe::raise_to(status.paced_ns, paced_ns);
    if (would_hold == 0) return;
    observe::raise_to(status.would_hold, would_hold);
    observe::raise_to(status.would_held_ns, would_held_ns);
    const auto& waits_for = chain.would_wait_for;
    const auto most = std::max_element(
        waits_for.begin(), waits_for.end(),
        [](const auto& a, const auto& b) { return a.load(kRelaxed) < b.load(kRelaxed); });
    if (most->load(kRelaxed) > 0)
        status.would_behind.store(static_cast<std::int32_t>(most - waits_for.begin()) + 1,
                                  kRelaxed);
}

void ChainStatus::ended(const ChainState& chain, nanoseconds latency, const observe::Cause& cause,
                        nanoseconds now) {
    abi::ChainStatus& status = common_.status.chain(chain.index);
    count(chain, status);
    Records& records = records_[chain.index];
    const std::uint64_t number = records.claimed.fetch_add(1, kRelaxed);
    abi::FrameRecord& frame = status.ring[number % abi::kFrameRing];
    frame.end_ns.store(now.count(), kRelaxed);
    frame.latency_us.store(to_us(latency), kRelaxed);
    frame.cause.store(static_cast<std::uint16_t>(cause.kind), kRelaxed);
    frame.behind.store(static_cast<std::int16_t>(cause.behind), kRelaxed);
    if (cause.kind != observe::MissCause::kNone) {
        if (own_log().tells(LogDetail::kDebug)) note_miss(chain, number + 1, latency, cause);
        status.causes[static_cast<std::size_t>(cause.kind)].fetch_add(1, kRelaxed);
        status.last_cause.store(static_cast<std::uint16_t>(cause.kind), kRelaxed);
        status.last_behind.store(static_cast<std::int16_t>(cause.behind), kRelaxed);
        status.last_late_us.store(to_us(latency - chain.deadline()), kRelaxed);
        status.last_amount_ns.store(cause.amount.count(), kRelaxed);
        status.last_detail.store(cause.detail, kRelaxed);
        status.last_miss.store(number + 1, kRelaxed);
    }
    // The thread that finds all claimed records written publishes their number. One that does not
    // find so leaves it to the last of those that are still writing, which sees its claim.
    const std::uint64_t written = records.written.fetch_add(1, std::memory_order_acq_rel) + 1;
    if (written == records.claimed.load(kRelaxed)) observe::raise_to(status.frames, written);
}

void ChainStatus::dropped(const ChainState& chain) {
    abi::ChainStatus& status = common_.status.chain(chain.index);
    count_misses(chain, status);
    status.causes[static_cast<std::size_t>(observe::MissCause::kDropped)].fetch_add(1, kRelaxed);
}

}  // namespace urgengo::runtime
