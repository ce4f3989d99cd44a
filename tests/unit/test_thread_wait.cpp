// SPDX-License-Identifier: Apache-2.0
#include "host/base/thread_wait.h"

#include <pthread.h>
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

namespace {

/// @param id  0 until the thread begins
/// @returns what it waits for in the end
ThreadWait settled(const std::atomic<int>& id) {
    ThreadWait wait{For::kNothing};
    for (int i = 0; i < 1000 && wait.what == For::kNothing; ++i) {
        std::this_thread::sleep_for(1ms);
        if (id != 0) wait = what_waits_for(id);
    }
    return wait;
}

/// @returns the thread that has such a mutex, as seen of one that waits for it
int owner_seen(const pthread_mutexattr_t& attributes, For what = For::kMutex) {
    pthread_mutex_t mutex;
    REQUIRE(pthread_mutex_init(&mutex, &attributes) == 0);
    pthread_mutex_lock(&mutex);
    std::atomic<int> id = 0;
    std::thread waits([&] {
        id = gettid();
        pthread_mutex_lock(&mutex);
        pthread_mutex_unlock(&mutex);
    });
    const ThreadWait wait = settled(id);
    CHECK(wait.what == what);
    pthread_mutex_unlock(&mutex);
    waits.join();
    pthread_mutex_destroy(&mutex);
    return wait.owner;
}

/// A thread that spins, then waits for a mutex of the test's, then ends.
class SpinsThenWaits {
  public:
    SpinsThenWaits() {
        while (id_ == 0) std::this_thread::yield();
    }
    SpinsThenWaits(const SpinsThenWaits&) = delete;
    SpinsThenWaits& operator=(const SpinsThenWaits&) = delete;
    ~SpinsThenWaits() {
        if (thread_.joinable()) end();
    }
    int id() const { return id_; }
    /// It goes on to wait. @returns what it is then seen to do
    ThreadWait waits() {
        goes_on_ = true;
        return settled(id_);
    }
    void end() {
        goes_on_ = true;
        lock_.unlock();
        thread_.join();
        wait_until_gone(id_);
    }

  private:
    std::mutex mutex_;
    std::unique_lock<std::mutex> lock_{mutex_};
    std::atomic<bool> goes_on_ = false;
    std::atomic<int> id_ = 0;
    std::thread thread_{[this] {
        id_ = gettid();
        while (!goes_on_) continue;
        const std::lock_guard waits(mutex_);
    }};
};

}  // namespace

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
    const ThreadWait wait = settled(id);
    CHECK(wait.what == For::kUnknown);
    CHECK(wait.owner == 0);
    {
        const std::lock_guard lock(mutex);
        ends = true;
    }
    changes.notify_all();
    waits.join();
}

TEST_CASE("It is known which thread has a mutex of whatever kind", "[base][threads]") {
    for (const int kind : {PTHREAD_MUTEX_RECURSIVE, PTHREAD_MUTEX_ERRORCHECK}) {
        pthread_mutexattr_t attributes;
        pthread_mutexattr_init(&attributes);
        pthread_mutexattr_settype(&attributes, kind);
        CHECK(owner_seen(attributes) == gettid());
    }
    pthread_mutexattr_t adapts;
    pthread_mutexattr_init(&adapts);
    pthread_mutexattr_settype(&adapts, PTHREAD_MUTEX_ADAPTIVE_NP);
    CHECK(owner_seen(adapts) == gettid());
    pthread_mutexattr_t inherits;
    pthread_mutexattr_init(&inherits);
    pthread_mutexattr_setprotocol(&inherits, PTHREAD_PRIO_INHERIT);
    CHECK(owner_seen(inherits) == gettid());
}

TEST_CASE("Nothing is told of a robust mutex, and of one that processes share", "[base][threads]") {
    pthread_mutexattr_t robust, shared, inherits_and_shared;
    for (auto* attributes : {&robust, &shared, &inherits_and_shared})
        pthread_mutexattr_init(attributes);
    pthread_mutexattr_setrobust(&robust, PTHREAD_MUTEX_ROBUST);
    pthread_mutexattr_setpshared(&shared, PTHREAD_PROCESS_SHARED);
    pthread_mutexattr_setpshared(&inherits_and_shared, PTHREAD_PROCESS_SHARED);
    pthread_mutexattr_setprotocol(&inherits_and_shared, PTHREAD_PRIO_INHERIT);
    for (const auto* attributes : {&robust, &shared, &inherits_and_shared})
        CHECK(owner_seen(*attributes, For::kUnknown) == 0);
}

TEST_CASE("A number that is waited for is no mutex", "[base][threads]") {
    struct alignas(64) {
        std::atomic<int> number = 2;  // what a mutex has that is waited for
        int count = 0, owner = 0, users = 0, kind = 0;
    } looks_like_one;
    looks_like_one.owner = gettid();
    std::atomic<int> id = 0;
    std::thread waits([&] {
        id = gettid();
        looks_like_one.number.wait(2);
    });
    CHECK(settled(id).what == For::kUnknown);
    looks_like_one.number = 3;
    looks_like_one.number.notify_all();
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
    wait_until_gone(ended);
    const OtherThread spins(Does::kSpin);
    errno = EDOM;
    CHECK(what_waits_for(ended).what == For::kUnknown);
    CHECK(what_waits_for(-1).what == For::kUnknown);
    CHECK(what_waits_for(spins.id()).what == For::kNothing);
    CHECK(errno == EDOM);
}

TEST_CASE("What the system says of a task's thread is believed for a moment", "[sched][absence]") {
    sched::TaskThread thread;
    CHECK(thread.wait(1s).what == For::kUnknown);  // none yet
    SpinsThenWaits other;
    thread.has(other.id());
    CHECK(thread.wait(1s).what == For::kNothing);
    CHECK(other.waits().what == For::kMutex);
    CHECK(thread.wait(1s + 199us).what == For::kNothing);
    CHECK(thread.wait(1s + 200us).what == For::kMutex);
    CHECK(thread.wait(1s + 201us).owner == gettid());
    other.end();
    const OtherThread next(Does::kSpin);
    thread.has(next.id());  // of which nothing is known yet
    CHECK(thread.wait(1s + 202us).what == For::kNothing);
}

TEST_CASE("A thread that was never seen to wait for a mutex is asked seldom for the sake of one",
          "[sched][absence]") {
    sched::TaskThread thread;
    SpinsThenWaits other;
    thread.has(other.id());
    CHECK(thread.wait_early(1s).what == For::kNothing);
    CHECK(other.waits().what == For::kMutex);
    CHECK(thread.wait_early(1s + 1999us).what == For::kNothing);
    CHECK(thread.wait_early(1s + 2ms).what == For::kMutex);
    other.end();
    CHECK(thread.wait_early(1s + 2199us).what == For::kMutex);
    CHECK(thread.wait_early(1s + 2200us).what == For::kUnknown);  // it has ended
}

TEST_CASE("A thread that had the last instances is the usual one", "[sched][absence]") {
    sched::TaskThread thread;
    for (int i = 0; i < 3; ++i) thread.has(1);
    CHECK_FALSE(thread.is_usual());
    thread.has(1);
    CHECK(thread.is_usual());
    thread.has(2);
    CHECK_FALSE(thread.is_usual());
}

}  // namespace urgengo::testing
