// SPDX-License-Identifier: Apache-2.0
#include "host/sched/binding.h"

#include "host/sched/admission.h"
#include "tests/support/catch.h"

using namespace urgengo;
using config::Binding;
using sched::level_of;

namespace {

sched::Decision ranked(int rank, int num_tasks, bool urgent = false) {
    sched::Decision d;
    d.rank = rank;
    d.num_tasks = num_tasks;
    d.urgent = urgent;
    return d;
}

}  // namespace

TEST_CASE("A kernel's level is its rank, and the last ones share the least", "[sched][binding]") {
    CHECK(level_of(Binding::kKernel, ranked(0, 9), 0, 6) == 0);
    CHECK(level_of(Binding::kKernel, ranked(4, 9), 0, 6) == 4);
    CHECK(level_of(Binding::kKernel, ranked(5, 9), 0, 6) == 5);
    CHECK(level_of(Binding::kKernel, ranked(8, 9), 0, 6) == 5);
    CHECK(level_of(Binding::kKernel, ranked(3, 9), 0, 1) == 0);  // a device without priorities
}

TEST_CASE("A task is bound to a level from 1 on, the top one is for the truly urgent",
          "[sched][binding]") {
    CHECK(level_of(Binding::kTask, ranked(3, 9, true), 0, 6) == 0);
    CHECK(level_of(Binding::kTask, ranked(0, 1), 0, 6) == 1);
    CHECK(level_of(Binding::kTask, ranked(0, 10), 0, 6) == 1);
    CHECK(level_of(Binding::kTask, ranked(1, 10), 0, 6) == 1);
    CHECK(level_of(Binding::kTask, ranked(2, 10), 0, 6) == 2);
    CHECK(level_of(Binding::kTask, ranked(5, 10), 0, 6) == 3);
    CHECK(level_of(Binding::kTask, ranked(8, 10), 0, 6) == 5);
    CHECK(level_of(Binding::kTask, ranked(9, 10), 0, 6) == 5);
    CHECK(level_of(Binding::kTask, ranked(1, 2), 0, 2) == 1);
    CHECK(level_of(Binding::kTask, ranked(1, 2), 0, 1) == 0);
}

TEST_CASE("A static level is the bucket of the chain", "[sched][binding]") {
    CHECK(sched::bucket_of(0, 10, 6) == 0);
    CHECK(sched::bucket_of(1, 10, 6) == 0);
    CHECK(sched::bucket_of(2, 10, 6) == 1);
    CHECK(sched::bucket_of(9, 10, 6) == 5);
    CHECK(sched::bucket_of(2, 3, 6) == 4);
    CHECK(sched::bucket_of(0, 0, 6) == 0);  // no chains, no order
    CHECK(level_of(Binding::kStatic, ranked(7, 9), 3, 6) == 3);
    CHECK(level_of(Binding::kStatic, ranked(0, 9), 5, 4) == 3);
}

TEST_CASE("Without binding all have the least level", "[sched][binding]") {
    CHECK(level_of(Binding::kNone, ranked(0, 9, true), 0, 6) == 5);
    CHECK(level_of(Binding::kNone, ranked(8, 9), 3, 6) == 5);
}

TEST_CASE("As many levels are used as wanted, if the device has them", "[sched][binding]") {
    CHECK(sched::num_levels(0, 0, -5) == 6);
    CHECK(sched::num_levels(2, 0, -5) == 2);
    CHECK(sched::num_levels(9, 0, -5) == 6);
    CHECK(sched::num_levels(0, 0, 0) == 1);
}
