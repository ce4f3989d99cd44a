// SPDX-License-Identifier: Apache-2.0
#include "host/identity/name_gate.h"

namespace urgengo::identity {

void NameGate::close() {
    num_unloading_.fetch_add(1);
    if (num_reading_.load() == 0) return;
    SteadyClock clock;
    const nanoseconds begin = clock.now();
    for (nanoseconds waited{0}; num_reading_.load() != 0 && waited < kLongestWait;
         waited = clock.now() - begin)
        clock.sleep_for(asking_interval(waited));
}

}  // namespace urgengo::identity
