// SPDX-License-Identifier: Apache-2.0
//
// Which streams and events carry which task's work.
#include "host/runtime/work_on_streams.h"

#include "host/identity/stream_id.h"
#include "tests/support/runs_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

const CUevent kEvent = reinterpret_cast<CUevent>(0xe);
constexpr auto kLegacy = exec::StreamFlavor::kLegacy;

/// Thread a runs the task `tight`.
struct WorkOnStreamsTest : RunsFixture {
    runtime::WorkOnStreams streams{common(), runs};

    WorkOnStreamsTest() { begin_run(thread_a, tight()); }
    void launch(CUstream stream) {
        REQUIRE(runs.take(thread_a, tight()));
        streams.follow(tight(), {kConv, 100, 256, stream});
        streams.used_by(tight(), stream);
        observe::bump(tight().counters.launches);
        ++thread_a.line.launches;
        thread_a.line.stream = stream;
        runs.release(thread_a);
    }
    std::optional<bool> covers_all(CUstream stream, CUevent event = nullptr) {
        const auto function = event ? abi::TraceWait::kEvent : abi::TraceWait::kStream;
        return streams.covers_all(thread_a, {function, stream, kLegacy, event}, false);
    }
};

}  // namespace

TEST_CASE("A stream is of the only task that has used it, until it is destroyed",
          "[runtime][work_on_streams]") {
    WorkOnStreamsTest f;
    CHECK(f.streams.owner(kStreamA) == nullptr);
    f.streams.used_by(f.tight(), kStreamA);
    f.streams.used_by(f.tight(), nullptr);  // everybody's
    CHECK(f.streams.owner(kStreamA) == &f.tight());
    CHECK(f.streams.owner(nullptr) == nullptr);
    SECTION("destroyed") {
        CHECK_FALSE(f.streams.destroyed(kStreamA));
    }
    SECTION("used by another") {
        f.streams.used_by(f.loose(), kStreamA);
    }
    CHECK(f.streams.owner(kStreamA) == nullptr);
}

TEST_CASE("A wait for one of two streams is not one for all", "[runtime][work_on_streams]") {
    WorkOnStreamsTest f;
    f.launch(kStreamA);
    CHECK_FALSE(f.covers_all(kStreamA));  // the thread's own count tells
    f.launch(kStreamB);
    REQUIRE(f.tight().streams.is_forked);
    CHECK(f.covers_all(kStreamB) == false);
    SECTION("but a wait for an event behind both is") {
        f.streams.recorded(f.thread_a, kEvent, kStreamA, kLegacy);
        f.streams.stream_waits(f.thread_a, kStreamB, kLegacy, kEvent);
        CHECK(f.covers_all(kStreamB) == true);
        CHECK(f.streams.covered_has_executed(f.thread_a, f.tight()));
    }
    SECTION("nor is one for an event that is gone") {
        f.streams.recorded(f.thread_a, kEvent, kStreamA, kLegacy);
        f.streams.event_destroyed(kEvent);
        f.streams.stream_waits(f.thread_a, kStreamB, kLegacy, kEvent);
        CHECK(f.covers_all(kStreamB) == false);
    }
    SECTION("nor is it when the other stream has gone, whose work may not be done") {
        f.streams.destroyed(kStreamA);
        CHECK(f.covers_all(kStreamB) == false);
        CHECK_FALSE(f.tight().streams.graph.knows(identity::stream_id(kStreamA, kLegacy)));
    }
}
