// SPDX-License-Identifier: Apache-2.0
//
// Without hints: when an instance has arrived, and how its chain's tasks hand it on (instances.cpp
// says by which rules).
#include <algorithm>

#include "host/runtime/runtime.h"

namespace urgengo::runtime {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
/// A thread off the CPU for less than this between two instances did not wait for its next frame.
constexpr nanoseconds kNotAsleep{500'000};
/// Where deadlines are short, this part of one.
constexpr int kNotAsleepOfDeadline = 32;

}  // namespace

// For the arrival of what comes next. Threads that give hints tell it themselves.
void Runtime::note_end_of_wait(ThreadState& thread, nanoseconds now) {
    if (thread.named.num_candidates == 0 || thread.uses_hints) return;
    thread.wait_end = now;
    thread.wait_end_cpu_us = observe::thread_cpu_us();
}

// Of a frame that begins at once it makes no difference whether its thread has slept, and it is not
// asked: where the kernel's code and data are not in the caches, that takes 3 us.
Runtime::SinceWait Runtime::since_wait(const ThreadState& thread, const TaskState& task,
                                       nanoseconds now) {
    if (thread.wait_end.count() == 0) return {};
    const nanoseconds wall = now - thread.wait_end;
    if (wall <= std::min(kNotAsleep, task.chain->config.deadline / kNotAsleepOfDeadline))
        return {.cpu = wall};
    const std::uint32_t cpu_us = observe::thread_cpu_us() - thread.wait_end_cpu_us;
    const nanoseconds cpu = std::min<nanoseconds>(std::chrono::microseconds(cpu_us), wall);
    return {.cpu = cpu, .slept = wall - cpu > kNotAsleep};
}

nanoseconds Runtime::estimated_arrival(const ThreadState& thread, const TaskState& task,
                                       const SinceWait& since, nanoseconds now) {
    const nanoseconds arrival = now - since.cpu;
    const nanoseconds last(task.chain->last_arrival_ns.load(kRelaxed));
    // Behind: this frame was due before the thread was done with the last one. But not by more than
    // makes a difference.
    if (thread.wait_end.count() == 0 || last.count() == 0 || since.slept) return arrival;
    if (thread.wait_end <= last + task.chain->config.period) return arrival;
    const nanoseconds due =
        std::max(last + task.chain->config.period, now - 2 * task.chain->longest());
    return std::min(arrival, due);
}

nanoseconds Runtime::enter_chain(const ThreadState& thread, TaskState& task, nanoseconds now) {
    const SinceWait since = since_wait(thread, task, now);
    const nanoseconds estimated = estimated_arrival(thread, task, since, now);
    ChainState& chain = task.its_chain();
    if (chain.tasks.size() == 1) {  // there is nobody to hand it on to
        enter(chain, estimated);
        return estimated;
    }
    const std::lock_guard lock(instances_mutex_);
    auto& passages = chain.passages;
    const auto ready = [&](const identity::ChainPassage& p) {
        return task.stage > 0 && p.next_stage == task.stage && !p.running;
    };
    // A thread that has slept since its last wait had nothing to do then: of what the stage before
    // had finished by then, it has skipped all that is there no more.
    while (since.slept && std::count_if(passages.begin(), passages.end(), ready) > 1) {
        const auto oldest = std::find_if(passages.begin(), passages.end(), ready);
        if (oldest->finished >= thread.wait_end) break;
        passages.erase(oldest);
        chain.missed();
    }
    if (const auto next = std::find_if(passages.begin(), passages.end(), ready);
        next != passages.end()) {
        next->running = true;
        ++next->next_stage;
        return next->arrival;
    }
    // Frames that never came to their end: the program dropped them on the way.
    const auto dropped = [&](const identity::ChainPassage& p) {
        return estimated - p.arrival > chain.abandoned_after();
    };
    for (auto n = std::erase_if(passages, dropped); n > 0; --n) chain.missed();
    enter(chain, estimated);
    if (passages.size() < identity::InstanceRing::kSize)
        passages.push_back({estimated, task.stage + 1, true});
    return estimated;
}

void Runtime::leave_stage(const TaskState& task, nanoseconds arrival, nanoseconds now) {
    if (task.chain->tasks.size() == 1) return;
    const std::lock_guard lock(instances_mutex_);
    auto& passages = task.its_chain().passages;
    const auto ours =
        std::find_if(passages.begin(), passages.end(), [&](const identity::ChainPassage& p) {
            return p.running && p.next_stage == task.stage + 1 && p.arrival == arrival;
        });
    if (ours == passages.end()) return;
    if (task.index == task.chain->tasks.back()) return void(passages.erase(ours));
    ours->running = false;
    ours->finished = now;
}

}  // namespace urgengo::runtime
