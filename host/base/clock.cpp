// SPDX-License-Identifier: Apache-2.0
#include "host/base/clock.h"

#include <sys/prctl.h>
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

FineTimerSlack::FineTimerSlack() : previous_ns_(prctl(PR_GET_TIMERSLACK)) {
    if (previous_ns_ > 0) prctl(PR_SET_TIMERSLACK, 1);
}

FineTimerSlack::~FineTimerSlack() {
    if (previous_ns_ > 0) prctl(PR_SET_TIMERSLACK, static_cast<unsigned long>(previous_ns_));
}

}  // namespace urgengo
