// SPDX-License-Identifier: Apache-2.0
#include "host/base/clock.h"

#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>

namespace urgengo {

void SteadyClock::sleep_for(nanoseconds duration) {
    const int saved_errno = errno;
    timespec t{duration.count() / 1'000'000'000, duration.count() % 1'000'000'000};
    // An early return (EINTR: a signal of the program) only makes the caller look sooner.
    syscall(SYS_clock_nanosleep, CLOCK_MONOTONIC, 0, &t, nullptr);
    errno = saved_errno;
}

ThreadUse SteadyClock::thread_use() {
    rusage usage{};
    getrusage(RUSAGE_THREAD, &usage);
    const auto time = [](const timeval& t) {
        return std::chrono::seconds(t.tv_sec) + std::chrono::microseconds(t.tv_usec);
    };
    return {time(usage.ru_utime) + time(usage.ru_stime), usage.ru_nvcsw};
}

FineTimerSlack::FineTimerSlack() : previous_ns_(prctl(PR_GET_TIMERSLACK)) {
    if (previous_ns_ > 0) prctl(PR_SET_TIMERSLACK, 1);
}

FineTimerSlack::~FineTimerSlack() {
    if (previous_ns_ > 0) prctl(PR_SET_TIMERSLACK, static_cast<unsigned long>(previous_ns_));
}

}  // namespace urgengo
