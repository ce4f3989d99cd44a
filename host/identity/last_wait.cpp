// SPDX-License-Identifier: Apache-2.0
#include "host/identity/last_wait.h"

#include <algorithm>

#include "host/observe/trace_writer.h"

namespace urgengo::identity {
namespace {

/// Where deadlines are short, this part of one.
constexpr int kNotAsleepOfDeadline = 32;

}  // namespace

void LastWait::ended(nanoseconds now) {
    end_ = now;
    end_cpu_us_ = observe::thread_cpu_us();
}

nanoseconds LastWait::computed(const sched::GovernedChain& chain, nanoseconds now) const {
    if (end_.count() == 0) return nanoseconds{0};
    const nanoseconds wall = now - end_;
    // Of a frame that begins at once it makes no difference whether its thread has slept, and it is
    // not asked: where the kernel's code and data are not in the caches, that takes 3 us.
    if (wall <= std::min(sched::Backlog::kNotAsleep, chain.deadline() / kNotAsleepOfDeadline))
        return wall;
    const std::uint32_t cpu_us = observe::thread_cpu_us() - end_cpu_us_;
    return std::min<nanoseconds>(std::chrono::microseconds(cpu_us), wall);
}

}  // namespace urgengo::identity
