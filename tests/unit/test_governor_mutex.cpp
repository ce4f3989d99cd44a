// SPDX-License-Identifier: Apache-2.0
//
// Loans for a thread that waits for a mutex: the task whose thread has it goes, and no other.
#include <unistd.h>

#include <atomic>
#include <future>
#include <mutex>
#include <thread>
#include <tuple>
#include <utility>

#include "tests/support/catch.h"
#include "tests/support/governor_fixture.h"
#include "tests/support/other_thread.h"

using namespace urgengo;
using namespace urgengo::testing;
using sched::Answer;
using sched::Loan;
using Does = OtherThread::Does;

namespace {

config::Scheduler packed() {
    config::Scheduler scheduler;
    scheduler.policy = config::Policy::kEdf;
    scheduler.admission = config::Admission::kPacked;
    return scheduler;
}

/// Task 0 is first, and farther ahead than a lead. Task 1 is more urgent, and its frame is due for
/// 5 ms. Task 2 comes behind both.
struct Awaited {
    GovernorFixture f{{100ms, 20ms, 300ms}, packed()};

    Awaited() {
        f.frames_come(1);
        f.now += 20ms;
        f.begin(0, 60ms);
        f.begin(2, 60ms);
        f.now += 5ms;
        for (int i = 0; i < 60; ++i) f.launch(0, 500us);
    }
    /// The thread of the urgent task, and of the other two.
    void threads(int urgent, int first, int behind) {
        for (int i = 0; i < 4; ++i) f.task(1).thread.has(urgent);
        f.task(0).thread.has(first);
        f.task(2).thread.has(behind);
    }
    /// The first one has launched anew, no farther ahead than a lead.
    void is_within_lead() {
        f.execute(0);
        for (int i = 0; i < 5; ++i) f.launch(0, 500us);
    }
    Answer ask(int task) { return f.ask(task); }
    int level(int task, const sched::Decision& decision) {
        return f.governor.levels(f.task(task), true, decision, f.now).level;
    }
};

/// A thread that has a mutex for which another one waits.
class HasMutex {
  public:
    enum class AndThen { kSpins, kWaits };  ///< for a mutex of the test's

    explicit HasMutex(AndThen then)
        : lock_(mutex_), thread_([this, then] {
              const OtherThread waits(OtherThread::Does::kWaitForLock);
              ids_.set_value({gettid(), waits.id()});
              while (then == AndThen::kSpins && !ends_) continue;
              const std::lock_guard waits_itself(mutex_);
          }) {
        std::tie(own_, waiting_) = ids_.get_future().get();
        const auto wanted =
            then == AndThen::kSpins ? ThreadWait::For::kNothing : ThreadWait::For::kMutex;
        for (int i = 0; i < 1000 && what_waits_for(own_).what != wanted; ++i)
            std::this_thread::sleep_for(1ms);
    }
    HasMutex(const HasMutex&) = delete;
    HasMutex& operator=(const HasMutex&) = delete;
    ~HasMutex() {
        ends_ = true;
        lock_.unlock();
        thread_.join();
    }
    int id() const { return own_; }
    int waiting() const { return waiting_; }

  private:
    std::atomic<bool> ends_ = false;
    std::mutex mutex_;
    std::unique_lock<std::mutex> lock_;
    std::promise<std::pair<int, int>> ids_;
    std::thread thread_;
    int own_ = 0, waiting_ = 0;
};

/// The thread of task 2 has the mutex for which the urgent one's waits, and task 0 is within a
/// lead.
struct MutexOfLast : Awaited {
    const HasMutex has{HasMutex::AndThen::kSpins};
    const OtherThread other{OtherThread::Does::kSpin};

    MutexOfLast() {
        threads(has.waiting(), other.id(), has.id());
        is_within_lead();
    }
};

}  // namespace

TEST_CASE("First task goes as a lead, however far, for a thread that waits for its mutex",
          "[sched][governor][mutex]") {
    const OtherThread waits(Does::kWaitForLock), other(Does::kSpin);
    Awaited awaited;
    CHECK(awaited.ask(0).wait);  // as long as it is not known what is waited for
    awaited.threads(waits.id(), gettid(), other.id());
    const Answer first = awaited.ask(0);
    CHECK_FALSE(first.wait);
    CHECK(first.loan == Loan::kToLead);
    // Below what comes, above what is less urgent.
    CHECK(awaited.level(0, first.decision) == 3);
    sched::Decision behind;
    behind.before.insert(0);
    behind.rank = 1;
    CHECK(awaited.level(2, behind) > 3);
    CHECK(awaited.level(1, {}) < 3);
}

TEST_CASE("Nothing is lent to a task whose thread has not the mutex that is waited for",
          "[sched][governor][mutex]") {
    MutexOfLast awaited;
    CHECK(awaited.ask(0).loan == Loan::kNone);
    const Answer has_it = awaited.ask(2);
    CHECK_FALSE(has_it.wait);
    CHECK(has_it.loan == Loan::kToHeld);
    // The one that has it may poll for something that the other one is to do.
    awaited.f.now += 8ms;
    awaited.f.execute(0);
    CHECK_FALSE(awaited.ask(0).wait);
    for (int i = 0; i < 5; ++i) awaited.f.launch(0, 500us);
    CHECK(awaited.ask(0).loan == Loan::kToFirst);
}

TEST_CASE("A thread of a pool may not be the one that comes next", "[sched][governor][mutex]") {
    MutexOfLast awaited;
    awaited.f.task(1).thread.has(awaited.other.id());
    awaited.f.task(1).thread.has(awaited.has.waiting());  // by turns
    CHECK(awaited.ask(0).loan == Loan::kToFirst);
    CHECK(awaited.ask(2).loan == Loan::kToHeld);
}

TEST_CASE("A thread that waits for the GPU for any of its tasks may wait for the one that is held",
          "[sched][governor][mutex]") {
    MutexOfLast awaited;
    awaited.f.launch(2, 500us);
    CHECK(awaited.f.slot(2).lent_until_ns == 0);
    awaited.f.slot(2).waits = 1;
    awaited.f.task(1).chain->config.criticality = 3;
    CHECK(awaited.ask(0).loan == Loan::kToFirst);
    // And its work is as urgent as the one that waits for the mutex.
    const auto urgent = awaited.f.task(1).chain->expectation.awaited(20ms, 20ms, 0ms);
    CHECK(awaited.f.slot(2).lent_deadline_ns == urgent->deadline.count());
    CHECK(awaited.f.slot(2).lent_until_ns == nanoseconds(500us).count());
    CHECK(awaited.f.slot(2).lent_criticality == 3);
    CHECK(awaited.f.slot(2).lent_static_rank == 1);
}

TEST_CASE("For a mutex it is lent as soon as the frame is due", "[sched][governor][mutex]") {
    const OtherThread waits(Does::kWaitForLock), other(Does::kSpin);
    GovernorFixture f{{100ms, 20ms, 300ms}, packed()};
    f.frames_come(1);
    f.now += 20ms - 50us;
    f.begin(0, 60ms);
    f.begin(2, 60ms);
    for (int i = 0; i < 4; ++i) f.task(1).thread.has(waits.id());
    f.task(0).thread.has(other.id());
    f.task(2).thread.has(gettid());
    for (int i = 0; i < 5; ++i) f.launch(0, 500us);
    CHECK(f.ask(2).loan == Loan::kNone);  // it is not due yet
    f.now += 100us;
    CHECK(f.ask(0).loan == Loan::kNone);
    CHECK(f.ask(2).loan == Loan::kToHeld);
    f.task(2).thread.has(other.id());
    f.task(0).thread.has(gettid());
    CHECK(f.ask(0).loan == Loan::kToFirst);  // one that is only paced, too
    CHECK(f.ask(2).loan == Loan::kNone);
}

TEST_CASE("For a mutex it is lent within the jitter, and after loans in vain",
          "[sched][governor][mutex]") {
    const OtherThread waits(Does::kWaitForLock), other(Does::kSpin);
    Awaited awaited;
    sched::Expectation& urgent = awaited.f.task(1).chain->expectation;
    urgent.lend(awaited.f.now - 20ms);  // for the frame before
    urgent.arrived(awaited.f.now - 5ms, 20ms);
    urgent.launched(awaited.f.now - 5ms, awaited.f.now - 5ms);
    awaited.f.now += 16ms;  // 1 ms beyond the margin
    REQUIRE(urgent.awaited(20ms, 20ms, 0ms)->rests);
    awaited.f.execute(0);
    CHECK_FALSE(awaited.ask(0).wait);
    for (int i = 0; i < 60; ++i) awaited.f.launch(0, 500us);
    awaited.f.now += 2ms;
    awaited.f.slot(2).waits = 1;  // else it seems to wait for a lock, too
    CHECK(awaited.ask(0).loan == Loan::kNone);
    awaited.threads(waits.id(), gettid(), other.id());
    CHECK(awaited.ask(0).loan == Loan::kToLead);
}

TEST_CASE("Paced task goes for a less urgent one that does not come, farther than a lead as one",
          "[sched][governor][mutex]") {
    GovernorFixture f{{100ms, 200ms}, packed()};
    f.frames_come(1);
    f.now += 200ms;
    f.begin(0, 60ms);
    for (int i = 0; i < 5; ++i) f.launch(0, 500us);
    CHECK(f.ask(0).wait);  // it is due right now
    f.now += 5ms;
    f.execute(0);
    f.ask(0);
    for (int i = 0; i < 5; ++i) f.launch(0, 500us);
    CHECK(f.ask(0).loan == Loan::kToPaced);
    for (int i = 0; i < 50; ++i) f.launch(0, 500us);
    const Answer lead = f.ask(0);
    CHECK(lead.loan == Loan::kToLead);
    CHECK(f.governor.levels(f.task(0), true, lead.decision, f.now).level > 0);
    for (int i = 0; i < 460; ++i) f.launch(0, 10us);
    CHECK(f.ask(0).loan == Loan::kNone);
}

TEST_CASE("A thread of a pool that has begun an instance is the one that is awaited",
          "[sched][governor][mutex]") {
    MutexOfLast awaited;
    awaited.f.begin(1, 1ms);
    awaited.f.now += 5ms;  // it has launched nothing
    awaited.f.task(1).thread.has(awaited.other.id());
    awaited.f.task(1).thread.has(awaited.has.waiting());
    CHECK(awaited.ask(0).loan == Loan::kNone);
    CHECK(awaited.ask(2).loan == Loan::kToHeld);
}

TEST_CASE("First task leads for a mutex no farther than the driver lets it",
          "[sched][governor][mutex]") {
    const OtherThread waits(Does::kWaitForLock), other(Does::kSpin);
    Awaited awaited;
    awaited.threads(waits.id(), gettid(), other.id());
    CHECK(awaited.ask(0).loan == Loan::kToLead);
    for (int i = 0; i < 460; ++i) awaited.f.launch(0, 10us);
    CHECK(awaited.ask(0).loan == Loan::kNone);
}

TEST_CASE("A loan follows a row of mutexes", "[sched][governor][mutex]") {
    const HasMutex between(HasMutex::AndThen::kWaits);
    const OtherThread other(Does::kSpin);
    Awaited awaited;
    awaited.threads(between.waiting(), gettid(), between.id());
    CHECK(awaited.ask(0).loan == Loan::kToLead);
    awaited.f.now += 1ms;
    // A thread of no chain has the last one, which says nothing of the first task's.
    awaited.threads(between.waiting(), other.id(), between.id());
    CHECK(awaited.ask(0).loan == Loan::kNone);
}

TEST_CASE("A mutex of a thread of no chain ends holds of all, but lets none lead",
          "[sched][governor][mutex]") {
    const OtherThread waits(Does::kWaitForLock), other(Does::kSpin), third(Does::kSpin);
    Awaited awaited;
    awaited.threads(waits.id(), other.id(), third.id());
    CHECK(awaited.ask(0).wait);
    const Answer held = awaited.ask(2);
    CHECK(held.loan == Loan::kToHeld);
}
