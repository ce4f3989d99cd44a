// SPDX-License-Identifier: Apache-2.0
#include "host/observe/executed_pieces.h"

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using observe::ExecutedPiece;
using observe::ExecutedPoint;
using observe::LaunchedWork;
using observe::pieces_of;
using observe::WorkSegment;
using std::chrono::nanoseconds;

namespace {

/// 4 ms of work behind 100 ms of it, waited for from 10 ms to 20 ms.
WorkSegment segment() {
    return {.begin = 10ms,
            .end = 20ms,
            .first_work = 100ms,
            .last_work = 104ms,
            .how_ends = WorkSegment::End::kExecuted};
}

/// All of it is launched at its begin.
std::vector<LaunchedWork> launched_at_once() {
    return {{10ms, 100ms, 101ms}, {10ms, 101ms, 102ms}, {10ms, 102ms, 104ms}};
}

void check(const ExecutedPiece& piece, nanoseconds begin, nanoseconds end, nanoseconds work) {
    CHECK(piece.begin == begin);
    CHECK(piece.end == end);
    CHECK(piece.work == work);
}

}  // namespace

TEST_CASE("Segment without marks is one piece", "[observe][executed_pieces]") {
    const auto pieces = pieces_of(segment(), {}, launched_at_once());
    REQUIRE(pieces.size() == 1);
    check(pieces[0], 10ms, 20ms, 4ms);
    CHECK(pieces[0].took() == 10ms);
    CHECK(pieces[0].executes_from() == 16ms);
    CHECK(pieces[0].executes_until() == 20ms);
}

TEST_CASE("Marks cut a segment into pieces, each with the work between them",
          "[observe][executed_pieces]") {
    const auto pieces = pieces_of(segment(), {{13ms, 101ms}, {14ms, 102ms}}, launched_at_once());
    REQUIRE(pieces.size() == 3);
    check(pieces[0], 10ms, 13ms, 1ms);
    check(pieces[1], 13ms, 14ms, 1ms);
    check(pieces[2], 14ms, 20ms, 2ms);
    CHECK(observe::took(pieces) == 10ms);
}

TEST_CASE("Piece begins when what it executes was launched", "[observe][executed_pieces]") {
    // The GPU waits for the second launch from 11 to 15 ms, and for the third from 16 to 17.
    const std::vector<LaunchedWork> launches = {
        {10ms, 100ms, 101ms}, {15ms, 101ms, 102ms}, {17ms, 102ms, 104ms}};
    SECTION("between marks") {
        const auto pieces = pieces_of(segment(), {{11ms, 101ms}, {16ms, 102ms}}, launches);
        REQUIRE(pieces.size() == 3);
        check(pieces[0], 10ms, 11ms, 1ms);
        check(pieces[1], 15ms, 16ms, 1ms);
        check(pieces[2], 17ms, 20ms, 2ms);
    }
    SECTION("within one piece, as far as the plan says") {
        const auto pieces = pieces_of(segment(), {}, launches);
        REQUIRE(pieces.size() == 1);
        check(pieces[0], 15ms, 20ms, 4ms);
    }
    SECTION("not where it was executing what was launched before") {
        const auto pieces = pieces_of(segment(), {{18ms, 102ms}}, launches);
        REQUIRE(pieces.size() == 2);
        check(pieces[0], 14ms, 18ms, 2ms);
        check(pieces[1], 18ms, 20ms, 2ms);
    }
    SECTION("launches that the log has forgotten were there") {
        const auto pieces = pieces_of(segment(), {}, {launches.back()});
        REQUIRE(pieces.size() == 1);
        check(pieces[0], 15ms, 20ms, 4ms);  // 2 ms, then it waited until 17
        CHECK(pieces_of(segment(), {}, {}).at(0).begin == 10ms);
        // Of a later segment.
        const auto before = pieces_of(segment(), {}, {{30ms, 104ms, 105ms}});
        REQUIRE(before.size() == 1);
        check(before[0], 10ms, 20ms, 4ms);
    }
}

TEST_CASE("Points out of order, of other segments or without sense tell nothing",
          "[observe][executed_pieces]") {
    const std::vector<ExecutedPoint> points = {
        {15ms, 102ms},                 // seen before the next one, which executed before it
        {13ms, 101ms}, {16ms, 101ms},  // two streams
        {14ms, 100ms}, {14ms, 90ms},  {14ms, 300ms},  // of another segment
        {9ms, 102ms},                                 // before it began
        {24ms, 103ms},  // later than all was, by the two clocks' difference
    };
    const auto pieces = pieces_of(segment(), points, launched_at_once());
    REQUIRE(pieces.size() == 3);
    check(pieces[0], 10ms, 13ms, 1ms);
    check(pieces[1], 13ms, 15ms, 1ms);
    check(pieces[2], 15ms, 20ms, 2ms);
}

TEST_CASE("Segment that its thread has left ends with its last mark",
          "[observe][executed_pieces]") {
    WorkSegment left = segment();
    left.how_ends = WorkSegment::End::kLeft;
    CHECK(pieces_of(left, {}, launched_at_once()).empty());
    const auto pieces = pieces_of(left, {{13ms, 101ms}, {25ms, 104ms}}, launched_at_once());
    REQUIRE(pieces.size() == 2);
    check(pieces[0], 10ms, 13ms, 1ms);
    check(pieces[1], 13ms, 25ms, 3ms);  // marks come after it was left
}

TEST_CASE("Last piece of a segment that is under way is open, and executes since its begin",
          "[observe][executed_pieces]") {
    WorkSegment open = segment();
    open.how_ends = WorkSegment::End::kOpen;
    open.last_work = 102ms;  // of the next mark
    const auto pieces = pieces_of(open, {{13ms, 101ms}}, launched_at_once());
    REQUIRE(pieces.size() == 2);
    check(pieces[1], 13ms, 20ms, 1ms);
    CHECK_FALSE(pieces[0].is_open);
    CHECK(pieces[1].is_open);
    CHECK(pieces[1].executes_from() == 13ms);
    CHECK(pieces[1].executes_until() == 14ms);
    open.last_work = 101ms;  // nothing is launched behind it
    CHECK(pieces_of(open, {{13ms, 101ms}}, launched_at_once()).size() == 1);
}

TEST_CASE("Joined pieces keep their work and the time that they took",
          "[observe][executed_pieces]") {
    const std::vector<ExecutedPiece> all = {{10ms, 12ms, 1ms},
                                            {12ms, 15ms, 2ms},
                                            {17ms, 18ms, 1ms},
                                            {18ms, 20ms, 2ms},
                                            {20ms, 25ms, 1ms, true}};
    auto pieces = all;
    observe::join(pieces, 5);
    CHECK(pieces.size() == 5);
    observe::join(pieces, 2);
    REQUIRE(pieces.size() == 2);
    check(pieces[0], 10ms, 18ms, 4ms);
    CHECK(pieces[0].idle == 2ms);
    CHECK(pieces[0].took() == 6ms);
    CHECK_FALSE(pieces[0].is_open);
    check(pieces[1], 18ms, 25ms, 3ms);
    CHECK(pieces[1].is_open);
    observe::join(pieces, 1);
    REQUIRE(pieces.size() == 1);
    check(pieces[0], 10ms, 25ms, 7ms);
    CHECK(observe::took(pieces) == observe::took(all));
    pieces.clear();
    observe::join(pieces, 1);
    CHECK(pieces.empty());
}

TEST_CASE("What was launched behind a gate executes once that is open",
          "[observe][executed_pieces]") {
    auto launches = launched_at_once();
    launches.push_back({15ms, 104ms, 105ms});
    observe::put_behind_gate(launches, 10ms, 14ms);
    CHECK(launches[0].time == 14ms);
    CHECK(launches[2].time == 14ms);
    CHECK(launches[3].time == 15ms);
    check(pieces_of(segment(), {}, launches).at(0), 14ms, 20ms, 4ms);
}
