// SPDX-License-Identifier: Apache-2.0
#include "host/identity/last_wait.h"

#include <algorithm>

#include "host/observe/trace_writer.h"

namespace urgengo::identity {
namespace {

/// A thread off the CPU for less than this between two instances did not wait for its next frame.
constexpr nanoseconds kNotAsleep{500'000};
/// Where deadlines are short, this part of one.
constexpr int kNotAsleepOfDeadline = 32;

}  // namespace

void LastWait::ended(nanoseconds now) {
    end_ = now;
    end_cpu_us_ = observe::thread_cpu_us();
}

LastWait::Frame LastWait::next_frame(const sched::GovernedChain& chain, nanoseconds now) const {
    if (end_.count() == 0) return {.arrival = now};
    const nanoseconds wall = now - end_;
    nanoseconds cpu = wall;
    bool slept = false;
    // Of a frame that begins at once it makes no difference whether its thread has slept, and it is
    // not asked: where the kernel's code and data are not in the caches, that takes 3 us.
    if (wall > std::min(kNotAsleep, chain.config.deadline / kNotAsleepOfDeadline)) {
        const std::uint32_t cpu_us = observe::thread_cpu_us() - end_cpu_us_;
        cpu = std::min<nanoseconds>(std::chrono::microseconds(cpu_us), wall);
        slept = wall - cpu > kNotAsleep;
    }
    const nanoseconds arrival = now - cpu;
    const nanoseconds last(chain.last_arrival_ns.load(std::memory_order_relaxed));
    // Behind: this frame was due before the thread was done with the last one. But not by more than
    // makes a difference.
    if (last.count() == 0 || slept || end_ <= last + chain.config.period)
        return {.arrival = arrival, .slept = slept};
    const nanoseconds due = std::max(last + chain.config.period, now - 2 * chain.longest());
    return {.arrival = std::min(arrival, due), .slept = slept};
}

}  // namespace urgengo::identity
