// SPDX-License-Identifier: Apache-2.0
#include "host/base/thread_wait.h"

#include <unistd.h>

#include <cerrno>
#include <thread>

#include "host/sched/task_thread.h"
#include "tests/support/catch.h"
#include "tests/support/other_thread.h"

namespace urgengo::testing {

using namespace std::chrono_literals;
using Does = OtherThread::Does;

TEST_CASE("A thread that runs goes on by itself, one that waits for a lock does not",
          "[base][threads]") {
    const OtherThread spins(Does::kSpin), waits(Does::kWaitForLock);
    CHECK(goes_on_by_itself(spins.id()));
    CHECK_FALSE(goes_on_by_itself(waits.id()));
}

TEST_CASE("A thread that sleeps until a time goes on by itself", "[base][threads]") {
    const OtherThread sleeps(Does::kSleep);
    int by_itself = 0;
    for (int i = 0; i < 50; ++i) {
        by_itself += goes_on_by_itself(sleeps.id());
        std::this_thread::sleep_for(1ms);
    }
    CHECK(by_itself == 50);
}

TEST_CASE("A thread that has ended does not go on, and asking leaves errno alone",
          "[base][threads]") {
    int ended = 0;
    std::thread([&] { ended = gettid(); }).join();
    const OtherThread spins(Does::kSpin);
    errno = EDOM;
    CHECK_FALSE(goes_on_by_itself(ended));
    CHECK_FALSE(goes_on_by_itself(-1));
    CHECK(goes_on_by_itself(spins.id()));
    CHECK(errno == EDOM);
}

TEST_CASE("What the system says of a task's thread is believed for a moment", "[sched][absence]") {
    sched::TaskThread thread;
    CHECK_FALSE(thread.goes_on_by_itself(1s));  // none yet
    const OtherThread spins(Does::kSpin), waits(Does::kWaitForLock);
    thread.has(spins.id());
    CHECK(thread.goes_on_by_itself(1s));
    thread.has(waits.id());
    CHECK(thread.goes_on_by_itself(1s + 199us));
    CHECK_FALSE(thread.goes_on_by_itself(1s + 200us));
    thread.has(spins.id());
    CHECK_FALSE(thread.goes_on_by_itself(1s + 399us));
    CHECK(thread.goes_on_by_itself(1s + 400us));
}

}  // namespace urgengo::testing
