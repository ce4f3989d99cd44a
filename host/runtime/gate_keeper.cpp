// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/gate_keeper.h"

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "host/config/progress_choice.h"

namespace urgengo::runtime {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;

/// As the driver has them, which reads the variable when it starts.
int connections() {
    constexpr int kDefault = 8, kMost = 32;
    const char* value = std::getenv("CUDA_DEVICE_MAX_CONNECTIONS");
    return value ? std::clamp(std::atoi(value), 1, kMost) : kDefault;
}

config::Dispatch usable(const config::Scheduler& s, bool launches_block) {
    using namespace config;
    const bool can = s.admission == Admission::kPacked && s.tracking == Tracking::kProgress &&
                     choose_source(s.progress_source) == ProgressSource::kKernel && !launches_block;
    return can ? s.dispatch : Dispatch::kThread;
}

}  // namespace

GateKeeper::GateKeeper(const config::Scheduler& scheduler, bool launches_block,
                       const Around& around)
    : scheduler_(scheduler),
      around_(around),
      opens_by_(usable(scheduler, launches_block)),
      most_gated_(connections() - 2),
      rounds_(around.page),
      dispatcher_(around.driver, around.page, scheduler.device_dispatch,
                  around.roster.tasks().size()) {
    abi::DispatchSettings& page = around_.page.dispatch;
    page.policy.store(static_cast<std::uint32_t>(scheduler.policy), kRelaxed);
    page.lambda.store(scheduler.lambda, kRelaxed);
    page.pack_limit_ppm.store(sched::to_load(scheduler.pack_limit), kRelaxed);
    page.share_limit_ppm.store(
        sched::to_load(std::max(scheduler.share_limit, scheduler.pack_limit)), kRelaxed);
    page.share_slack_ns.store(scheduler.share_slack.count(), kRelaxed);
}

bool GateKeeper::begins() {
    if (is_parked() || gated_.load(kRelaxed) >= most_gated_) {
        refused_.fetch_add(1, kRelaxed);
        return false;
    }
    if (!thread_is_made_.exchange(true)) start(*new exec::PollerThread());
    exec::Poller* const thread = thread_.load(std::memory_order_acquire);
    if (!thread || !thread->wake()) return false;  // none, or the process is about to end
    gated_.fetch_add(1, kRelaxed);
    return true;
}

void GateKeeper::start(exec::Poller& poller) {
    const auto stopped = [this] { park(); };  // for good: nothing else opens by time
    if (!poller.start([this] { return look(); }, stopped)) return;
    thread_.store(&poller, std::memory_order_release);
    if (!are_opened_by_gpu() || scheduler_.device_dispatch != config::DeviceDispatch::kLeased)
        return;
    // A thread of its own: what it calls of the driver may wait for work behind a gate.
    auto* const leases = new exec::PollerThread();
    const auto extend = [this] {
        dispatcher_.extend_lease(scheduler_.lease);
        return gated_.load(kRelaxed) > 0 ? exec::More::kLater : exec::More::kNone;
    };
    if (leases->start(extend, {})) lease_thread_.store(leases, std::memory_order_release);
}

void GateKeeper::ends(TaskState& task, nanoseconds now) {
    GatedLaunches& gates = task.gates;
    if (std::exchange(gates.is_open, true)) return;
    gated_.fetch_sub(1, kRelaxed);
    abi::TaskSlot& slot = *task.slot;
    sched::open_gate(slot, slot.gates_closed.load(kRelaxed), now);
    // At least a nanosecond: what is launched from now on was not slow by itself.
    const nanoseconds opened(slot.gate_opened_ns.load(kRelaxed));
    const nanoseconds waited =
        std::clamp(opened - gates.since, nanoseconds{1}, now - gates.since + nanoseconds{1});
    (gates.is_hold ? task.run.held : task.run.paced) += waited;
    bump(gates.is_hold ? task.counters.held_ns : task.counters.paced_ns,
         std::int64_t{waited.count()});
    around_.governor.queue().leaves(task.index);
}

void GateKeeper::segment_ended(TaskState& task, nanoseconds now) {
    if (!are_on()) return;
    ends(task, now);
    changed();
}

// A round goes by what has been seen of marks.
int GateKeeper::run_round(nanoseconds now) {
    const sched::Tasks& tasks = around_.governor.tasks();
    tasks.for_each_active([&](sched::GovernedTask& task) {
        if (sched::may_be_on_gpu(task)) tasks.look(task, now);
    });
    return rounds_.run(now);
}

void GateKeeper::changed() {
    if (gated_.load(kRelaxed) > 0) run_round(around_.clock.now());
}

void GateKeeper::closed() {
    closed_.fetch_add(1, kRelaxed);
    if (!thread_.load(std::memory_order_acquire)->wake()) open_all(around_.clock.now());
    if (exec::Poller* const leases = lease_thread_.load(std::memory_order_acquire)) leases->wake();
}

void GateKeeper::open_all(nanoseconds now) {
    for (const auto& task : around_.roster.tasks())
        sched::open_gate(*task->slot, task->slot->gates_closed.load(), now);
}

// Whatever a round does, or keeps another one from doing: a store of the GPU's may close again what
// the host has opened, and a round of a program's thread waits for that thread's turn.
void GateKeeper::open_overdue(nanoseconds now) {
    const model::TaskSet active = model::TaskSet::read_from(around_.page.active);
    for (const auto& task : around_.roster.tasks()) {
        abi::TaskSlot& slot = *task->slot;
        if (!active.contains(task->index) || now.count() >= slot.gate_by_ns.load(kRelaxed))
            sched::open_gate(slot, slot.gates_closed.load(), now);
    }
}

void GateKeeper::park() {
    if (!are_on()) return;
    const bool is_first = around_.page.dispatch.parked.fetch_add(1) == 0;
    dispatcher_.end_lease();
    if (is_first && gated_.load() != 0) parks_.fetch_add(1, kRelaxed);
    open_all(around_.clock.now());
}

void GateKeeper::unpark() {
    if (are_on() && around_.page.dispatch.parked.fetch_sub(1) == 1) dispatcher_.go_on();
}

exec::More GateKeeper::look() {
    const nanoseconds now = around_.clock.now();
    publish_clock(now);
    if (!around_.governor.schedules()) {
        open_all(now);
        return exec::More::kNone;
    }
    // Launches behind gates ask for no plan.
    around_.governor.plan().refresh(now);
    open_overdue(now);
    if (run_round(now) == 0) return exec::More::kNone;
    return opens_by_ == config::Dispatch::kHost ? exec::More::kSoon : exec::More::kLater;
}

void GateKeeper::publish_clock(nanoseconds now) {
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
                              .parks = parks_.load(kRelaxed)};
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
