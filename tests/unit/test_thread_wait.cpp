// SPDX-License-Identifier: Apache-2.0
#include "host/base/thread_wait.h"

#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "host/sched/task_thread.h"
#include "tests/support/catch.h"
#include "tests/support/other_thread.h"

namespace urgengo::testing {

using namespace std::chrono_literals;
using Does = OtherThread::Does;
using For = ThreadWait::For;

TEST_CASE("A thread that runs goes on by itself, one that waits for a lock does not",
          "[base][threads]") {
    const OtherThread spins(Does::kSpin), waits(Does::kWaitForLock);
    CHECK(what_waits_for(spins.id()).what == For::kNothing);
    CHECK(what_waits_for(waits.id()).what == For::kMutex);
    CHECK(what_waits_for(waits.id()).owner == gettid());
}

TEST_CASE("A thread that waits for a condition waits for no mutex", "[base][threads]") {
    std::mutex mutex;
    std::condition_variable changes;
    bool ends = false;
    std::atomic<int> id = 0;
    std::thread waits([&] {
        std::unique_lock lock(mutex);
        id = gettid();
        changes.wait(lock, [&] { return ends; });
    });
    ThreadWait wait{For::kNothing};
    for (int i = 0; i < 1000 && wait.what == For::kNothing; ++i) {
        std::this_thread::sleep_for(1ms);
        if (id != 0) wait = what_waits_for(id);
    }
    CHECK(wait.what == For::kUnknown);
    CHECK(wait.owner == 0);
    {
        const std::lock_guard lock(mutex);
        ends = true;
    }
    changes.notify_all();
    waits.join();
}

TEST_CASE("A thread that sleeps until a time goes on by itself", "[base][threads]") {
    const OtherThread sleeps(Does::kSleep);
    int by_itself = 0;
    for (int i = 0; i < 50; ++i) {
        by_itself += what_waits_for(sleeps.id()).what == For::kNothing;
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
    CHECK(what_waits_for(ended).what == For::kUnknown);
    CHECK(what_waits_for(-1).what == For::kUnknown);
    CHECK(what_waits_for(spins.id()).what == For::kNothing);
    CHECK(errno == EDOM);
}

TEST_CASE("What the system says of a task's thread is believed for a moment", "[sched][absence]") {
    sched::TaskThread thread;
    CHECK(thread.wait(1s).what != For::kNothing);  // none yet
    const OtherThread spins(Does::kSpin), waits(Does::kWaitForLock);
    thread.has(spins.id());
    CHECK(thread.wait(1s).what == For::kNothing);
    thread.has(waits.id());
    CHECK(thread.wait(1s + 199us).what == For::kNothing);
    CHECK(thread.wait(1s + 200us).what != For::kNothing);
    thread.has(spins.id());
    CHECK(thread.wait(1s + 399us).what != For::kNothing);
    CHECK(thread.wait(1s + 400us).what == For::kNothing);
}

}  // namespace urgengo::testing
