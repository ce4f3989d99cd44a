// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/gate_keeper.h"

#include <algorithm>
#include <cstdlib>
#include <new>
#include <utility>

#include "host/base/memory_orders.h"
#include "host/config/connections.h"
#include "host/sched/gate_groups.h"

namespace urgengo::runtime {
namespace {

// Our thread looks this often where the GPU opens gates, on a core that it gets at once.
constexpr nanoseconds kPunctual{2'000'000};

double to_us(const std::atomic<std::int64_t>& time_ns) {
    return 1e-3 * static_cast<double>(time_ns.load(kRelaxed));
}

int connections() {
    return config::driver_connections(std::getenv("CUDA_DEVICE_MAX_CONNECTIONS"));
}

}  // namespace

GateKeeper::GateKeeper(const config::Scheduler& scheduler, const config::Serialised& serialised,
                       const Around& around)
    : scheduler_(scheduler),
      around_(around),
      choice_(config::choose_dispatch(scheduler, serialised, around.roster.tasks().size(),
                                      connections())),
      most_gated_(connections() - config::kUngatedConnections),
      rounds_(around.page),
      events_(around.page, around.roster, around.records, around.clock),
      dispatcher_(around.driver, around.page, scheduler.dispatch, around.roster.tasks().size()) {
    sched::store_settings(around_.page.dispatch, scheduler);
}

std::string GateKeeper::note() const {
    return choice_.is_for_tool
               ? "dispatch: " + choice_.why_thread + ": launches wait in their threads"
               : "";
}

bool GateKeeper::begins() {
    const bool is_refused_by_park = is_parked();
    if (is_refused_by_park || gated_.load(kRelaxed) >= most_gated_) {
        refused_.fetch_add(1, kRelaxed);
        if (is_refused_by_park) events_.refused();
        return false;
    }
    if (!threads_.are_made.exchange(true)) start(*new exec::PollerThread(), nullptr);
    exec::Poller* const thread = threads_.opens.load(std::memory_order_acquire);
    if (!thread || !thread->wake()) return false;  // none, or the process is about to end
    gated_.fetch_add(1, kRelaxed);
    return true;
}

void GateKeeper::start(exec::Poller& opens, exec::Poller* leases) {
    const auto stopped = [this] { stop(); };
    if (!opens.start([this] { return look(); }, stopped)) return;
    threads_.opens.store(&opens, std::memory_order_release);
    if (!are_opened_by_gpu() || scheduler_.dispatch.device == config::DeviceDispatch::kPiggyback)
        return;
    // A thread of its own: what it calls of the driver may wait for work behind a gate.
    if (!leases) leases = new exec::PollerThread();
    if (leases->start([this] { return extend(); }, {}))
        threads_.leases.store(leases, std::memory_order_release);
}

exec::More GateKeeper::extend() {
    take_nice(nice_of_leases_);
    beat(around_.clock.now());
    // A lease without a gate ends by itself, an arm does not.
    const bool is_armed = scheduler_.dispatch.device == config::DeviceDispatch::kArmed;
    const bool is_of_use = around_.governor.acts() && (!is_armed || gated_.load(kRelaxed) > 0);
    const bool is_extended = is_of_use && dispatcher_.extend_lease_from_outside(
                                              scheduler_.dispatch.lease, around_.clock.now());
    // That thread ticks arms through, and may have gone to sleep before they were there.
    if (is_armed) threads_.opens.load(std::memory_order_acquire)->wake();
    return is_extended && gated_.load(kRelaxed) > 0 ? exec::More::kLater : exec::More::kNone;
}

void GateKeeper::ends(TaskState& task, nanoseconds now) {
    GatedLaunches& gates = task.gates;
    if (std::exchange(gates.is_open, true)) return;
    gated_.fetch_sub(1, kRelaxed);
    abi::TaskSlot& slot = *task.slot;
    sched::open_gate(slot, slot.gates_closed.load(kRelaxed), now);
    const nanoseconds opened(slot.gate_opened_ns.load(kRelaxed));
    const nanoseconds past = opened - nanoseconds(slot.gate_by_ns.load(kRelaxed));
    if (past > kPunctual) {
        past_bound_.fetch_add(1, kRelaxed);
        observe::raise_to(most_past_ns_, std::int64_t{past.count()});
    }
    const nanoseconds waited = sched::waited_behind_gates(slot, gates.since, now);
    (gates.is_hold ? task.run.waited.held : task.run.waited.paced) += waited;
    bump(gates.is_hold ? task.counters.held_ns : task.counters.paced_ns,
         std::int64_t{waited.count()});
    if (gates.is_hold)
        task.facts.holds.add({task.tracked.arrival, gates.since, gates.since + waited,
                              around_.governor.tasks().chain_of(slot.queue_behind.load(kRelaxed))});
    around_.governor.queue().leaves(task.index);
    if (around_.nvtx) around_.nvtx->gates(task, observe::nvtx::Word::kGatesOpen);
    around_.records.hold_ended(task, gates.piece, gates.since + waited);
}

void GateKeeper::segment_ended(TaskState& task, nanoseconds now) {
    if (!are_on()) return;
    ends(task, now);
    changed();
}

// A round goes by what has been seen of marks.
int GateKeeper::run_round(nanoseconds now) {
    const nanoseconds begin = around_.clock.now();
    const sched::Tasks& tasks = around_.governor.tasks();
    GateEvents::Round round(now);
    tasks.for_each_active([&](sched::GovernedTask& task) {
        if (sched::may_be_on_gpu(task)) tasks.look(task, now);
        round.note(*task.slot);
    });
    const int closed = rounds_.run(now);
    events_.round_ended(round, begin);
    return closed;
}

void GateKeeper::changed() {
    if (gated_.load(kRelaxed) > 0) run_round(around_.clock.now());
}

void GateKeeper::closed() {
    closed_.fetch_add(1, kRelaxed);
    if (!threads_.opens.load(std::memory_order_acquire)->wake()) open_all(around_.clock.now());
    if (exec::Poller* const leases = threads_.leases.load(std::memory_order_acquire)) {
        // That thread may wait long for its turn.
        dispatcher_.extend_lease(scheduler_.dispatch.lease, around_.clock.now());
        leases->wake();
    }
}

/// @returns how many tasks had closed gates
std::uint32_t GateKeeper::open_all(nanoseconds now) {
    std::uint32_t gated = 0;
    for (const auto& task : around_.roster.tasks())
        gated += sched::open_gate(*task->slot, task->slot->gates_closed.load(), now);
    return gated;
}

// Whatever a round does, or keeps another one from doing: a store of the GPU's may close again what
// the host has opened, and a round of a program's thread waits for that thread's turn.
void GateKeeper::open_overdue(nanoseconds now) {
    const model::TaskSet active = model::TaskSet::read_from(around_.page.active);
    for (const auto& task : around_.roster.tasks()) {
        abi::TaskSlot& slot = *task->slot;
        if (!active.contains(task->index) || now.count() >= slot.gate_by_ns.load(kRelaxed) ||
            !task->chain->may_act())
            sched::open_gate(slot, slot.gates_closed.load(), now);
    }
}

void GateKeeper::park() {
    if (!are_on()) return;
    const bool is_first = around_.page.dispatch.parked.fetch_add(1) == 0;
    const nanoseconds begin = around_.clock.now();
    dispatcher_.end_lease();
    const int gated = is_first ? gated_.load() : 0;
    const std::uint32_t opened = open_all(begin);
    if (is_first) {
        const nanoseconds took = gated != 0 ? around_.clock.now() - begin : nanoseconds{0};
        events_.park_begins(
            {.begin = begin, .took = took, .has_gates = gated != 0, .gated = opened});
    }
    // Another tool may wait for what was behind a gate.
    if (around_.nvtx && gated != 0) around_.nvtx->dispatch(observe::nvtx::Word::kPark, gated);
}

void GateKeeper::unpark() {
    if (are_on() && events_.park_ends()) dispatcher_.go_on();
}

// For good: nothing else opens by time. A round of the GPU's that has read before may close again
// what is open here, so what is open is opened until it must have ended.
void GateKeeper::stop() {
    park();
    if (closed_.load(kRelaxed) == 0 || !are_opened_by_gpu()) return;
    constexpr int kTries = 10;
    constexpr nanoseconds kPause{500'000};
    for (int i = 0, ended = 0; i < kTries && ended < 2; ++i) {
        ended += dispatcher_.has_ended();
        around_.clock.sleep_for(kPause);
        open_all(around_.clock.now());
    }
}

void GateKeeper::trip() {
    if (are_on()) dispatcher_.never_again();
    holds_end();
}

// As in stop(): a round of the GPU's may be on its way.
bool GateKeeper::may_be_closed_again(nanoseconds now) const {
    constexpr nanoseconds kLate{100'000'000};
    const nanoseconds chains_end(chains_end_ns_.load(kRelaxed));
    const bool is_off = !around_.governor.acts() && now - of_thread_.scheduled_at < kLate;
    return is_off || (chains_end.count() > 0 && now - chains_end < kLate);
}

void GateKeeper::holds_of_chains_end() {
    if (!are_on()) return;
    const nanoseconds now = around_.clock.now();
    chains_end_ns_.store(now.count(), kRelaxed);
    open_overdue(now);
    if (exec::Poller* const thread = threads_.opens.load(std::memory_order_acquire)) thread->wake();
    changed();
}

// By our threads, in which nothing may be thrown.
void GateKeeper::take_nice(ThreadNice::Seen& seen) {
    if (!around_.nice || !around_.governor.acts()) return;
    try {
        around_.nice->take(seen);
    } catch (const std::bad_alloc&) {  // it stays as it is
    }
}

exec::More GateKeeper::look() {
    const observe::NvtxOut::Silent silent;
    take_nice(of_thread_.nice);
    const nanoseconds begin = around_.clock.now();
    if (of_thread_.rests != exec::More::kNone)
        slept(exec::rest_after(of_thread_.rests), begin - of_thread_.looked_at, begin);
    of_thread_.rests = look_once(begin);
    of_thread_.looked_at = around_.clock.now();
    if (are_opened_by_gpu()) events_.look_at_gpu(of_thread_.looked_at);
    return of_thread_.rests;
}

exec::More GateKeeper::look_once(nanoseconds now) {
    publish_clock(now);
    const bool has_arms = dispatcher_.look_at_arms(now, scheduler_.dispatch.lease);
    const auto idle = [&] {
        return has_arms || may_be_closed_again(now) ? exec::More::kLater : exec::More::kNone;
    };
    if (!around_.governor.acts()) {
        open_all(now);
        return idle();
    }
    of_thread_.scheduled_at = now;
    // Launches behind gates ask for no plan.
    around_.governor.plan().refresh(now);
    open_overdue(now);
    const int closed = run_round(now);
    if (around_.nvtx) around_.nvtx->round(closed);
    if (closed == 0) return idle();
    return are_opened_by_host_alone() ? exec::More::kSoon : exec::More::kLater;
}

void GateKeeper::beat(nanoseconds now) {
    around_.page.dispatch.beat_ns.store(now.count(), kRelaxed);
}

void GateKeeper::publish_clock(nanoseconds now) {
    beat(now);
    const auto known = around_.progress.gpu_clock().newest();
    if (!known) return;
    abi::DispatchSettings& page = around_.page.dispatch;
    page.gpu_clock_ahead.store(known->stamp - static_cast<std::uint64_t>(known->host.count()),
                               kRelaxed);
    page.clock_base_ns.store(now.count(), kRelaxed);
}

observe::GateStatistics GateKeeper::counts() const {
    observe::GateStatistics c{.closed = closed_.load(kRelaxed),
                              .refused = refused_.load(kRelaxed),
                              .past_bound = past_bound_.load(kRelaxed),
                              .most_past_us = to_us(most_past_ns_)};
    c.forsaken = dispatcher_.forsaken();
    c.urgent_laxity_us =
        1e-3 * static_cast<double>(around_.page.dispatch.gpu_urgent_laxity_ns.load(kRelaxed));
    events_.add_to(c);
    for (const auto& task : around_.roster.tasks())
        c.opened_by_gpu += task->slot->gates_opened_by_gpu.load(kRelaxed);
    const abi::DispatchSettings& page = around_.page.dispatch;
    c.gpu_rounds = page.gpu_rounds.load(kRelaxed);
    if (c.gpu_rounds > 0)
        c.gpu_round_us = static_cast<double>(page.gpu_round_us.load(kRelaxed)) /
                         static_cast<double>(c.gpu_rounds);
    return c;
}

}  // namespace urgengo::runtime
