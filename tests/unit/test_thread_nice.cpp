// SPDX-License-Identifier: Apache-2.0
//
// Where the process may not lower its nice value, only that it is refused is looked at.
#include "host/base/thread_nice.h"

#include <sched.h>
#include <sys/resource.h>

#include <cerrno>
#include <thread>

#include "tests/support/catch.h"
#include "tests/support/nice_value.h"

using urgengo::ThreadNice;
using urgengo::testing::may_be_nice;
using urgengo::testing::own_nice;

namespace {

constexpr int kNice = -5;

/// In a thread of its own: the test's stays as it is.
template <typename Work>
void in_thread(Work&& work) {
    std::thread(std::forward<Work>(work)).join();
}

}  // namespace

TEST_CASE("Thread has the nice value from when it takes it until it is given back",
          "[base][thread_nice]") {
    ThreadNice nice(kNice);
    const int expected = may_be_nice(kNice) ? kNice : 0;
    int first = 1, again = 1, back = 1, anew = 1, of_child = 1, for_it = 1;
    in_thread([&] {
        ThreadNice::Seen seen = 0;
        errno = 0;
        nice.take(seen);
        for_it = errno;
        first = own_nice();
        nice.take(seen);
        again = own_nice();
        in_thread([&] { of_child = own_nice(); });
        nice.give_back();
        back = own_nice();
        nice.take(seen);
        anew = own_nice();
        nice.thread_ends();
    });
    CHECK(first == expected);
    CHECK(again == expected);
    CHECK(of_child == 0);
    CHECK(back == 0);
    CHECK(anew == expected);
    CHECK(for_it == 0);
}

TEST_CASE("Another thread gives nice values back, but not of threads that have ended",
          "[base][thread_nice]") {
    if (!may_be_nice(kNice)) return;
    ThreadNice nice(kNice);
    int back = 1, kept = 1;
    in_thread([&] {
        ThreadNice::Seen seen = 0;
        nice.take(seen);
        in_thread([&] { nice.give_back(); });
        back = own_nice();
        nice.take(seen);
        nice.thread_ends();
        in_thread([&] { nice.give_back(); });
        kept = own_nice();
    });
    CHECK(back == 0);
    CHECK(kept == kNice);
}

TEST_CASE("No thread is touched that goes before others already, or in another way",
          "[base][thread_nice]") {
    ThreadNice nice(kNice);
    const bool may = may_be_nice(kNice);
    int nicer = 1, policy = -1, of_batch = 1;
    in_thread([&] {
        if (may) setpriority(PRIO_PROCESS, 0, kNice - 3);
        const int before = own_nice();
        ThreadNice::Seen seen = 0;
        nice.take(seen);
        nicer = own_nice() - before;
        if (!may) nicer = 0;
    });
    in_thread([&] {
        const sched_param none{};
        sched_setscheduler(0, SCHED_BATCH, &none);
        ThreadNice::Seen seen = 0;
        nice.take(seen);
        policy = sched_getscheduler(0);
        of_batch = own_nice();
    });
    CHECK(nicer == 0);
    CHECK(policy == SCHED_BATCH);
    CHECK(of_batch == 0);
}

TEST_CASE("Nothing is asked for when nothing is configured", "[base][thread_nice]") {
    ThreadNice nice(std::nullopt);
    int found = 1;
    in_thread([&] {
        ThreadNice::Seen seen = 0;
        nice.take(seen);
        CHECK(seen == 0);
        found = own_nice();
    });
    CHECK(found == 0);
}
