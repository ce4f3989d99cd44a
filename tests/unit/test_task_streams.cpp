// SPDX-License-Identifier: Apache-2.0
//
// What is said of a task's streams to those who have not taken it.
#include "host/runtime/task_streams.h"

#include "tests/support/catch.h"

using namespace urgengo;
using progress::StreamKind;

TEST_CASE("A task over two streams is forked until all of it has executed",
          "[runtime][task_streams]") {
    runtime::TaskStreams streams;
    CHECK_FALSE(streams.is_forked);
    streams.graph.move_to(1, StreamKind::kNonBlocking, 0);
    streams.graph.move_to(2, StreamKind::kNonBlocking, 3);
    streams.note();
    CHECK(streams.is_forked);
    streams.all_executed(5);
    CHECK_FALSE(streams.is_forked);
    CHECK(streams.was_forked);
}

TEST_CASE("Work that nobody has waited for within a whole instance is not waited for",
          "[runtime][task_streams]") {
    runtime::TaskStreams streams;
    streams.begin_run(0);
    streams.graph.move_to(1, StreamKind::kNonBlocking, 0);
    streams.graph.move_to(2, StreamKind::kNonBlocking, 3);
    streams.begin_run(3);
    CHECK(streams.is_forked);  // its launches are of the run that has just ended
    streams.begin_run(3);
    CHECK_FALSE(streams.is_forked);
}
