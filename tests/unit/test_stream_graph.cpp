// SPDX-License-Identifier: Apache-2.0
#include "host/progress/stream_graph.h"

#include "tests/support/catch.h"

using urgengo::progress::Coverage;
using urgengo::progress::kMaxStreams;
using urgengo::progress::StreamGraph;
using urgengo::progress::StreamId;
using urgengo::progress::StreamKind;

namespace {

constexpr StreamId kLegacy = 1;

/// A task that launches, records and waits, as a program does.
struct Program {
    StreamGraph graph;
    std::uint64_t launched = 0;
    StreamKind kind = StreamKind::kNonBlocking;  ///< of all but the legacy one

    StreamKind kind_of(StreamId stream) const {
        return stream == kLegacy ? StreamKind::kLegacy : kind;
    }
    void launch(StreamId stream, int times = 1) {
        graph.move_to(stream, kind_of(stream), launched);
        launched += static_cast<std::uint64_t>(times);
    }
    Coverage record(StreamId stream) { return graph.covered_by(stream, kind_of(stream), launched); }
    void wait(StreamId stream, const Coverage& event) {
        graph.waits_for(stream, kind_of(stream), event, launched);
    }
    void join(StreamId from, StreamId to) { wait(to, record(from)); }
    bool closes(StreamId stream) { return graph.covers_all(record(stream), launched); }
    void host_waits(StreamId stream) { graph.executed(record(stream), launched); }
};

}  // namespace

TEST_CASE("StreamGraph needs nothing but the stream of the last launch on a single stream",
          "[progress][stream_graph]") {
    Program p;
    p.launch(10, 5);
    CHECK(p.graph.vouches());
    CHECK(p.closes(10));
    CHECK_FALSE(p.closes(20));
    p.host_waits(10);
    CHECK(p.graph.vouches());
    p.launch(20);  // all on the other one has executed
    CHECK(p.graph.vouches());
    CHECK(p.closes(20));
}

TEST_CASE("StreamGraph closes a fork where it is joined", "[progress][stream_graph]") {
    Program p;
    p.launch(10);  // the trunk
    for (StreamId side : {20, 30, 40}) p.join(10, side);
    for (StreamId side : {20, 30, 40}) p.launch(side, 3);
    CHECK_FALSE(p.graph.vouches());
    for (StreamId stream : {10, 20, 30, 40}) CHECK_FALSE(p.closes(stream));
    p.join(20, 10);
    p.join(30, 10);
    CHECK_FALSE(p.closes(10));  // one branch is left
    p.join(40, 10);
    CHECK(p.closes(10));
    p.launch(10);
    CHECK(p.graph.vouches());
    CHECK(p.closes(10));
    CHECK_FALSE(p.closes(20));
}

TEST_CASE("StreamGraph follows a trunk that launches nothing itself", "[progress][stream_graph]") {
    Program p;
    for (int frame = 0; frame < 3; ++frame) {
        for (StreamId side : {20, 30, 40, 50}) p.join(10, side);
        for (int i = 0; i < 4; ++i)
            for (StreamId side : {20, 30, 40, 50}) p.launch(side);
        CHECK_FALSE(p.closes(10));
        for (StreamId side : {20, 30, 40, 50}) p.join(side, 10);
        CHECK(p.closes(10));
        p.graph.all_executed(p.launched);
    }
}

TEST_CASE("StreamGraph vouches on a side stream for the trunk before it",
          "[progress][stream_graph]") {
    Program p;
    p.launch(10, 2);
    p.join(10, 20);
    p.launch(20);
    CHECK(p.graph.vouches());
    p.join(10, 30);
    p.launch(30);
    CHECK_FALSE(p.graph.vouches());  // it is beside the one on 20
    p.launch(20);
    CHECK_FALSE(p.graph.vouches());
    p.join(30, 20);
    CHECK(p.graph.vouches());  // even before the next launch
}

TEST_CASE("StreamGraph's events cover what was before their record", "[progress][stream_graph]") {
    Program p;
    p.launch(10);
    const Coverage early = p.record(10);
    p.launch(10);
    p.wait(20, early);
    CHECK_FALSE(p.closes(20));
    CHECK_FALSE(p.graph.covers_all(early, p.launched));
    CHECK(p.graph.covers_all(p.record(10), p.launched));
    p.wait(20, p.record(10));
    CHECK(p.closes(20));
}

TEST_CASE("StreamGraph adds up waits of the host for one stream after the other",
          "[progress][stream_graph]") {
    Program p;
    p.launch(10);
    p.launch(20);
    p.launch(30);
    p.host_waits(10);
    CHECK_FALSE(p.closes(20));
    p.host_waits(20);
    CHECK(p.closes(30));
    CHECK(p.graph.vouches());
    p.launch(10);
    CHECK_FALSE(p.closes(10));
    CHECK_FALSE(p.closes(30));
}

TEST_CASE("StreamGraph orders the legacy stream with blocking ones alone",
          "[progress][stream_graph]") {
    Program p;
    p.kind = StreamKind::kBlocking;
    p.launch(20);
    p.launch(30);
    CHECK(p.closes(kLegacy));  // it comes after both
    p.launch(kLegacy);
    CHECK(p.graph.vouches());
    CHECK(p.closes(20));  // comes after that
    p.launch(20);
    CHECK(p.graph.vouches());
    CHECK(p.closes(20));
    CHECK(p.closes(kLegacy));
    p.launch(40);  // new, and after what was on the legacy one
    CHECK_FALSE(p.graph.vouches());
    CHECK(p.closes(kLegacy));

    Program q;
    q.launch(20);
    q.launch(kLegacy);
    CHECK_FALSE(q.graph.vouches());
    CHECK_FALSE(q.closes(kLegacy));
    CHECK_FALSE(q.closes(20));
}

TEST_CASE("StreamGraph spreads a wait on the legacy stream", "[progress][stream_graph]") {
    Program p;
    p.launch(20);
    const Coverage side = p.record(20);
    p.kind = StreamKind::kBlocking;
    p.launch(30);
    p.wait(kLegacy, side);
    CHECK(p.closes(kLegacy));
    CHECK(p.closes(30));
}

TEST_CASE("StreamGraph does not take a new stream for a destroyed one of the same handle",
          "[progress][stream_graph]") {
    Program p;
    p.launch(10);
    p.launch(20, 2);
    p.graph.forget(20, p.launched);
    CHECK_FALSE(p.graph.vouches());
    p.join(10, 20);  // another stream
    CHECK_FALSE(p.closes(20));
    p.launch(20);
    CHECK_FALSE(p.graph.vouches());
    CHECK_FALSE(p.closes(20));  // what was on the old one may not be done
    p.graph.all_executed(p.launched);
    p.launch(20);
    CHECK(p.closes(20));
}

TEST_CASE("StreamGraph uses branches again that are done", "[progress][stream_graph]") {
    Program p;
    for (StreamId stream = 10; stream < 1000; ++stream) {
        p.launch(stream);
        REQUIRE_FALSE(p.graph.is_lost());
        REQUIRE(p.graph.vouches());
        p.host_waits(stream);
    }
}

TEST_CASE("StreamGraph loses sight of more streams than it can follow, until all is done",
          "[progress][stream_graph]") {
    Program p;
    for (int i = 0; i < kMaxStreams; ++i) p.launch(static_cast<StreamId>(100 + i));
    CHECK_FALSE(p.graph.is_lost());
    p.launch(500);
    CHECK(p.graph.is_lost());
    CHECK_FALSE(p.graph.vouches());
    CHECK_FALSE(p.closes(500));
    p.launch(100);
    CHECK_FALSE(p.closes(100));
    p.graph.all_executed(p.launched);
    CHECK_FALSE(p.graph.is_lost());
    p.launch(500);
    CHECK(p.closes(500));
}

TEST_CASE("StreamGraph believes nothing of streams that it does not know",
          "[progress][stream_graph]") {
    Program p;
    p.launch(10);
    CHECK_FALSE(p.closes(99));
    p.join(99, 20);
    CHECK_FALSE(p.graph.knows(20));
    p.graph.forget(99, p.launched);
    CHECK(p.closes(10));
}
