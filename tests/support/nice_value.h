// SPDX-License-Identifier: Apache-2.0
//
// Nice values of threads, and whether this process may lower them.
#pragma once

#include <sched.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cstdint>
#include <thread>

namespace urgengo::testing {

inline int own_nice() {
    return getpriority(PRIO_PROCESS, 0);
}

/// Asked as it is done: a sandbox may know the one call and not the other.
inline bool may_be_nice(int nice) {
    struct {
        std::uint32_t size = 48, policy = SCHED_OTHER;
        std::uint64_t flags = 1;
        std::int32_t nice = 0;
        std::uint32_t priority = 0;
        std::uint64_t times[3] = {};
    } attributes;
    attributes.nice = nice;
    bool may = false;
    std::thread([&] { may = syscall(SYS_sched_setattr, 0, &attributes, 0) == 0; }).join();
    return may;
}

}  // namespace urgengo::testing
