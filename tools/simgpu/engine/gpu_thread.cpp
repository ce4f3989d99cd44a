// SPDX-License-Identifier: Apache-2.0
//
// The two threads of the simulated GPU; gpu_thread.h says who does what.
#include "tools/simgpu/engine/gpu_thread.h"

#include <pthread.h>
#include <signal.h>
#include <sys/prctl.h>

#include <algorithm>
#include <chrono>
#include <thread>

namespace urgengo::simgpu {
namespace {

/// How often memory is looked at while a stream waits for a value that only the host can write.
/// A shorter period takes a core, a longer one shows: on an H200 a gate opens within 6.5 us.
constexpr Time kPollPeriod = std::chrono::microseconds(20);

using Clock = std::chrono::steady_clock;

Time now() {
    return std::chrono::duration_cast<Time>(Clock::now().time_since_epoch());
}

/// Starts a thread that takes none of the program's signals and that is never joined.
void start_thread(const char* name, std::function<void()> body) {
    sigset_t all;
    sigset_t before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    std::thread thread(std::move(body));
    pthread_setname_np(thread.native_handle(), name);
    thread.detach();
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

}  // namespace

GpuThread& GpuThread::start(const Part& part,
                            std::function<void(const KernelRecord&)> kernel_done) {
    auto* gpu = new GpuThread(part, std::move(kernel_done));  // deliberately never deleted
    start_thread("simgpu", [gpu] { gpu->run_engine(); });
    start_thread("simgpu-host", [gpu] { gpu->run_host_calls(); });
    return *gpu;
}

GpuThread::GpuThread(const Part& part, std::function<void(const KernelRecord&)> kernel_done)
    : engine_(part, {.host_call =
                         [this](QueuePtr queue, std::function<void()> run) {
                             {
                                 std::lock_guard lock(host_calls_mutex_);
                                 host_calls_.emplace_back(std::move(queue), std::move(run));
                             }
                             host_calls_changed_.notify_one();
                         },
                     .kernel_done = std::move(kernel_done)}) {}

Fence GpuThread::submit(const QueuePtr& queue, Work work, std::vector<Fence> fences) {
    Command command{.work = std::move(work), .fences = std::move(fences)};
    std::lock_guard lock(inbox_mutex_);
    const bool was_idle = queue->progress.reached(queue->submitted);
    command.ticket = ++queue->submitted;
    const Fence fence{queue, command.ticket};
    // Stamped under the lock, with which the engine's thread reads the time too: nothing arrives
    // that is older than where the engine stands.
    post_locked({now(), queue, std::move(command)}, was_idle);
    return fence;
}

Fence GpuThread::tail(const QueuePtr& queue) {
    std::lock_guard lock(inbox_mutex_);
    return {queue, queue->submitted};
}

void GpuThread::post_locked(Item item, bool wake) {
    inbox_.push_back(std::move(item));
    if (!wake || wake_) return;
    wake_ = true;
    inbox_changed_.notify_one();
}

void GpuThread::run_engine() {
    prctl(PR_SET_TIMERSLACK, 1UL);
    std::vector<Item> items;
    std::unique_lock lock(inbox_mutex_);
    while (true) {
        // First look, then empty the inbox: what the program submitted before it wrote a value is
        // in there, with an earlier time than the horizon, at which the wait for the value ends.
        lock.unlock();
        engine_.look_at_memory();
        lock.lock();
        items.swap(inbox_);
        wake_ = false;
        const Time horizon = now();
        lock.unlock();
        for (Item& item : items) {
            engine_.advance_to(item.at);
            if (item.command) {
                engine_.submit(item.queue, std::move(*item.command));
            } else {
                engine_.finish_host_call(*item.queue);
            }
        }
        items.clear();
        engine_.advance_to(horizon);
        engine_.open_seen_waits();
        std::optional<Time> next = engine_.next_event();
        if (engine_.has_value_waits()) {
            const Time poll = horizon + kPollPeriod;
            next = next ? std::min(*next, poll) : poll;
        }
        lock.lock();
        // Whatever came in meanwhile, on busy streams too, is looked at before sleeping.
        if (!inbox_.empty()) continue;
        if (next) {
            inbox_changed_.wait_until(lock, Clock::time_point(*next), [this] { return wake_; });
        } else {
            inbox_changed_.wait(lock, [this] { return wake_; });
        }
    }
}

void GpuThread::run_host_calls() {
    std::unique_lock lock(host_calls_mutex_);
    while (true) {
        host_calls_changed_.wait(lock, [this] { return !host_calls_.empty(); });
        auto [queue, run] = std::move(host_calls_.front());
        host_calls_.pop_front();
        lock.unlock();
        run();
        {
            std::lock_guard inbox_lock(inbox_mutex_);
            post_locked({now(), queue, std::nullopt}, true);
        }
        queue.reset();
        lock.lock();
    }
}

}  // namespace urgengo::simgpu
