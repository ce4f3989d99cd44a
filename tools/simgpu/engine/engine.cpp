// SPDX-License-Identifier: Apache-2.0
//
// The event loop of the simulated GPU; engine.h says what it models.
#include "tools/simgpu/engine/engine.h"

#include <algorithm>
#include <cassert>
#include <utility>

namespace urgengo::simgpu {
namespace {

/// @returns the wait at the head of the stream; null if something else is there, or nothing
ValueWait* value_wait_of(StreamQueue& queue) {
    if (queue.commands.empty()) return nullptr;
    return std::get_if<ValueWait>(&queue.commands.front().work);
}

}  // namespace

Engine::Engine(const Part& part, Hooks hooks)
    : launch_overhead_(part.scaled(static_cast<double>(part.launch_overhead.count()))),
      hooks_(std::move(hooks)),
      devices_(static_cast<std::size_t>(part.num_in_machine), Device(part.num_sms)) {}

Engine::Device& Engine::device_of(const StreamQueue& queue) {
    return devices_[static_cast<std::size_t>(queue.device)];
}

void Engine::submit(const QueuePtr& queue, Command command) {
    add_legacy_fences(*queue, command.fences);
    queue->commands.push_back(std::move(command));
    if (!queue->active) {
        queue->active = true;
        active_.push_back(queue);
    }
}

void Engine::add_legacy_fences(const StreamQueue& queue, std::vector<Fence>& fences) const {
    using Kind = StreamQueue::Kind;
    if (queue.kind == Kind::kNonBlocking) return;
    const Kind other_kind = queue.kind == Kind::kLegacy ? Kind::kBlocking : Kind::kLegacy;
    for (const QueuePtr& other : active_) {
        if (other->kind == other_kind && other->group == queue.group && !other->commands.empty()) {
            fences.push_back({other, other->commands.back().ticket});
        }
    }
}

void Engine::finish_host_call(StreamQueue& queue) {
    assert(!queue.commands.empty());
    complete(queue);
}

void Engine::advance_to(Time time) {
    settle();
    while (!events_.empty() && events_.top().time <= time) {
        now_ = std::max(now_, events_.top().time);
        // All that is due at one moment happens before blocks are handed out, so that of two
        // kernels that become ready together the more urgent one goes first.
        while (!events_.empty() && events_.top().time <= now_) {
            const auto run = events_.top().run;
            events_.pop();
            run();
        }
        settle();
    }
    now_ = std::max(now_, time);
}

std::optional<Time> Engine::next_event() const {
    if (events_.empty()) return std::nullopt;
    return events_.top().time;
}

bool Engine::has_value_waits() const {
    return std::any_of(active_.begin(), active_.end(),
                       [](const QueuePtr& queue) { return value_wait_of(*queue) != nullptr; });
}

void Engine::look_at_memory() {
    seen_open_.clear();
    for (const QueuePtr& queue : active_) {
        const ValueWait* wait = value_wait_of(*queue);
        if (wait != nullptr && wait->is_open()) {
            seen_open_.push_back({queue, queue->commands.front().ticket});
        }
    }
}

void Engine::open_seen_waits() {
    for (const Fence& seen : seen_open_) {
        // The engine's own writes may have ended it meanwhile.
        if (!seen.passed()) value_wait_of(*seen.queue)->seen_open = true;
    }
    seen_open_.clear();
    settle();
}

void Engine::look_at(const MemoryRange& written) {
    for (const QueuePtr& queue : active_) {
        ValueWait* wait = value_wait_of(*queue);
        if (wait != nullptr && written.contains(wait->address)) wait->seen_open = true;
    }
}

void Engine::schedule(Time time, std::function<void()> run) {
    events_.push({time, next_order_++, std::move(run)});
}

/// Starts whatever may start now. One stream's completed value wait may open another's fence, so it
/// goes round until nothing changes.
void Engine::settle() {
    bool changed = true;
    while (changed) {
        changed = false;
        for (const QueuePtr& queue : active_) changed |= try_start(queue);
    }
    active_.erase(std::remove_if(active_.begin(), active_.end(),
                                 [](const QueuePtr& queue) {
                                     queue->active = !queue->commands.empty();
                                     return !queue->active;
                                 }),
                  active_.end());
    for (Device& device : devices_) dispatch_blocks(device);
}

/// @returns whether it completed a command
bool Engine::try_start(const QueuePtr& queue) {
    if (queue->head_started || queue->commands.empty()) return false;
    Command& command = queue->commands.front();
    const bool blocked = std::any_of(command.fences.begin(), command.fences.end(),
                                     [](const Fence& fence) { return !fence.passed(); });
    if (blocked) return false;
    command.fences.clear();

    return std::visit([&](auto& work) { return start(queue, work); }, command.work);
}

bool Engine::start(const QueuePtr& queue, KernelWork& work) {
    queue->head_started = true;
    Time ready = now_;
    if (queue->last_kernel_end && !work.overlaps_launch) {
        ready = std::max(ready, *queue->last_kernel_end + launch_overhead_);
    }
    if (ready > now_) {
        schedule(ready, [this, raw = queue.get()] { become_ready(*raw); });
    } else {
        become_ready(*queue);
    }
    return false;
}

void Engine::become_ready(StreamQueue& queue) {
    const auto& work = std::get<KernelWork>(queue.commands.front().work);
    queue.kernel = KernelRun{.queue = &queue,
                             .work = &work,
                             .order = next_order_++,
                             .num_undispatched = work.num_blocks,
                             .start = std::nullopt};
    device_of(queue).undispatched.insert(&*queue.kernel);
}

bool Engine::start(const QueuePtr& queue, CopyWork& work) {
    queue->head_started = true;
    Device& device = device_of(*queue);
    auto& line = device.copies[static_cast<std::size_t>(work.engine)];
    line.push_back(queue.get());
    if (line.size() == 1) start_copy(device, work.engine);
    return false;
}

bool Engine::start(const QueuePtr& queue, TimedWork& work) {
    queue->head_started = true;
    schedule(now_ + work.duration, [this, raw = queue.get()] {
        const auto& timed = std::get<TimedWork>(raw->commands.front().work);
        if (timed.run) timed.run(now_);
        look_at(timed.writes);
        complete(*raw);
    });
    return false;
}

bool Engine::start(const QueuePtr& queue, ValueWait& work) {
    // Seen open is not enough: the value may have changed back.
    work.seen_open = work.seen_open && work.is_open();
    if (!work.seen_open) return false;
    complete(*queue);
    return true;
}

bool Engine::start(const QueuePtr& queue, HostCall& work) {
    queue->head_started = true;
    hooks_.host_call(queue, work.run);
    return false;
}

void Engine::dispatch_blocks(Device& device) {
    auto& undispatched = device.undispatched;
    while (!undispatched.empty()) {
        KernelRun& run = **undispatched.begin();
        auto placement = device.sms.place(run.num_undispatched, run.work->blocks_per_sm);
        if (placement.empty()) return;
        if (!run.start) run.start = now_;
        for (const auto& share : placement) {
            run.num_undispatched -= share.num_blocks;
            run.num_running += share.num_blocks;
        }
        if (run.num_undispatched == 0) undispatched.erase(undispatched.begin());
        groups_.push_front({&run, std::move(placement)});
        schedule(now_ + run.work->block_time,
                 [this, group = groups_.begin()] { end_group(group); });
    }
}

void Engine::end_group(std::list<BlockGroup>::iterator group) {
    KernelRun& run = *group->run;
    device_of(*run.queue).sms.release(group->placement, run.work->blocks_per_sm);
    for (const auto& share : group->placement) run.num_running -= share.num_blocks;
    groups_.erase(group);
    if (run.num_running == 0 && run.num_undispatched == 0) end_kernel(run);
}

void Engine::end_kernel(KernelRun& run) {
    StreamQueue& queue = *run.queue;
    const KernelWork& work = *run.work;
    if (work.run) work.run(now_);
    if (work.stamp) work.stamp(*run.start, now_);
    queue.last_kernel_end = now_;
    if (hooks_.kernel_done) {
        hooks_.kernel_done({work.name, queue.device, queue.id, work.priority, work.num_blocks,
                            *run.start, now_, work.launch});
    }
    queue.kernel.reset();
    complete(queue);
}

void Engine::start_copy(Device& device, CopyEngine engine) {
    StreamQueue* const queue = device.copies[static_cast<std::size_t>(engine)].front();
    const auto& copy = std::get<CopyWork>(queue->commands.front().work);
    schedule(now_ + copy.duration, [this, &device, engine] { end_copy(device, engine); });
}

void Engine::end_copy(Device& device, CopyEngine engine) {
    auto& line = device.copies[static_cast<std::size_t>(engine)];
    StreamQueue& queue = *line.front();
    const auto& copy = std::get<CopyWork>(queue.commands.front().work);
    copy.run();
    look_at(copy.writes);
    line.pop_front();
    if (!line.empty()) start_copy(device, engine);
    complete(queue);
}

void Engine::complete(StreamQueue& queue) {
    const std::uint64_t ticket = queue.commands.front().ticket;
    // The command goes first: what it holds (a staging buffer, an allocation to free) is gone when
    // a waiter hears of its end.
    queue.commands.pop_front();
    queue.head_started = false;
    queue.progress.publish(ticket);
}

}  // namespace urgengo::simgpu
