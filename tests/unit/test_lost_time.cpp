// SPDX-License-Identifier: Apache-2.0
#include "host/observe/lost_time.h"

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using observe::ExecutedPiece;
using observe::FramesWork;
using observe::lost_time;
using observe::LostTime;
using observe::LostTo;
using observe::OthersSegment;
using std::chrono::nanoseconds;

namespace {

constexpr nanoseconds kDeadline = 100ms, kSooner = 90ms, kLater = 110ms;

FramesWork frame(std::vector<ExecutedPiece> pieces) {
    FramesWork own;
    own.deadline = kDeadline;
    own.pieces = std::move(pieces);
    return own;
}

OthersSegment segment(int chain, nanoseconds deadline, std::vector<ExecutedPiece> pieces) {
    return {.chain = chain, .deadline = deadline, .first_priority = 0, .pieces = std::move(pieces)};
}

LostTo to(const LostTime& lost, int chain) {
    for (const LostTo& its : lost.others)
        if (its.chain == chain) return its;
    return {.chain = chain};
}

bool is_about(nanoseconds time, nanoseconds expected) {
    return time >= expected - 1us && time <= expected + 1us;
}

}  // namespace

TEST_CASE("Frame whose work took what was planned has lost nothing", "[observe][lost_time]") {
    const auto lost = lost_time(frame({{10ms, 12ms, 2ms}, {12ms, 13ms, 1ms}}),
                                {segment(1, kSooner, {{5ms, 40ms, 10ms}})});
    CHECK(lost.by_itself == 0ms);
    CHECK(to(lost, 1).taken() == 0ms);
}

TEST_CASE("Of two co-runners only the one that executed while the frame waited took its time",
          "[observe][lost_time]") {
    // Both have a segment from 5 to 40 ms; what chain 1 has executed by 10 ms and from 30 ms on is
    // not what the frame waited for from 10 to 30 ms.
    const auto lost =
        lost_time(frame({{10ms, 30ms, 2ms}}),
                  {segment(1, kSooner, {{5ms, 10ms, 5ms}, {30ms, 40ms, 10ms}}),
                   segment(2, kSooner, {{5ms, 10ms, 1ms}, {10ms, 28ms, 18ms}, {28ms, 40ms, 1ms}})});
    CHECK(to(lost, 1).taken() == 0ms);
    CHECK(to(lost, 2).by_urgent == 18ms);
    CHECK(lost.by_itself == 0ms);
}

TEST_CASE("Frame's kernels that take twice their time are its own, also beside others",
          "[observe][lost_time]") {
    // 4 ms of work take 8 alone; of 6 ms beside another chain's 3 ms of work, 6 are its own and 3
    // the other's.
    const FramesWork own = frame({{10ms, 18ms, 4ms}, {18ms, 33ms, 6ms}});
    const auto lost = lost_time(own, {segment(1, kSooner, {{18ms, 33ms, 3ms}})});
    CHECK(is_about(lost.by_itself, 10ms));
    CHECK(is_about(to(lost, 1).by_urgent, 3ms));

    SECTION("by the factor of estimates, where it was never alone") {
        FramesWork beside = frame({{18ms, 33ms, 6ms}});
        const std::vector<OthersSegment> others = {segment(1, kSooner, {{18ms, 33ms, 3ms}})};
        CHECK(lost_time(beside, others).by_itself == 0ms);
        beside.factor = 2;
        CHECK(is_about(lost_time(beside, others).by_itself, 6ms));
    }
    SECTION("whatever one piece was off by") {
        FramesWork with_one = own;
        with_one.pieces.insert(with_one.pieces.begin(), {1ms, 9ms, 1ms});
        CHECK(is_about(lost_time(with_one, {segment(1, kSooner, {{18ms, 33ms, 3ms}})}).by_itself,
                       17ms));
    }
}

TEST_CASE("What others took is told by what they are to the frame", "[observe][lost_time]") {
    FramesWork own = frame({{10ms, 22ms, 2ms}});
    const auto taken = [&](nanoseconds deadline, ExecutedPiece piece, int priority) {
        OthersSegment other = segment(1, deadline, {piece});
        other.first_priority = priority;
        return to(lost_time(own, {other}), 1);
    };
    const ExecutedPiece before{9ms, 20ms, 11ms}, later{11ms, 21ms, 10ms};
    CHECK(taken(kSooner, before, 0).by_urgent == 10ms);
    CHECK(taken(kLater, before, 0).by_kernel == 10ms);
    CHECK(taken(kLater, later, 0).by_priority == 10ms);
    own.last_priority = -1;  // the frame's launches went before
    CHECK(taken(kLater, later, 0).by_kernel == 10ms);
    CHECK(taken(kLater, later, -1).by_priority == 10ms);
    own.waits_for = 1;
    CHECK(taken(kLater, later, -1).waited == 10ms);
    CHECK(taken(kSooner, before, 0).waited == 10ms);
}

TEST_CASE("Piece in which nobody executed was lost to those who were there",
          "[observe][lost_time]") {
    // As far as marks tell, the other one executed behind it.
    const auto lost =
        lost_time(frame({{10ms, 20ms, 1ms}}), {segment(1, kLater, {{9ms, 40ms, 5ms}})});
    CHECK(lost.by_itself == 0ms);
    CHECK(to(lost, 1).by_kernel == 9ms);
}

TEST_CASE("Hold counts for who executed meanwhile, and else for whom it was behind",
          "[observe][lost_time]") {
    FramesWork own = frame({});
    own.holds = {{10ms, 30ms, 1}};
    SECTION("held behind one by the queue while another's kernels ran") {
        const auto lost = lost_time(own, {segment(1, kSooner, {{9ms, 40ms, 1ms}}),
                                          segment(2, kSooner, {{10ms, 28ms, 18ms}})});
        CHECK(to(lost, 2).held == 18ms);
        CHECK(to(lost, 1).held == 2ms);
    }
    SECTION("nobody did") {
        CHECK(to(lost_time(own, {}), 1).held == 20ms);
    }
    SECTION("its own work was on the GPU for a part of it") {
        own.pieces = {{12ms, 15ms, 3ms}, {15ms, 18ms, 3ms}};
        CHECK(to(lost_time(own, {}), 1).held == 14ms);
    }
}

TEST_CASE("Bystanders are there where all chains get on more slowly than the GPU would",
          "[observe][lost_time]") {
    FramesWork own = frame({{10ms, 20ms, 10ms}, {20ms, 40ms, 4ms}});
    const std::vector<OthersSegment> others = {segment(1, kSooner, {{20ms, 40ms, 6ms}})};
    CHECK(to(lost_time(own, others), 1).by_urgent == 16ms);
    own.beside_bystanders = true;
    const auto lost = lost_time(own, others);
    // There for all of the 20 ms, in which chain 1 executed for 6.
    CHECK(is_about(to(lost, -1).by_urgent, 16'000us * 20 / 26));
    CHECK(is_about(to(lost, 1).by_urgent, 16'000us * 6 / 26));
    own.pieces.clear();
    own.holds = {{20ms, 40ms, 1}};
    CHECK(to(lost_time(own, others), -1).held == 20ms);
    CHECK(to(lost_time(own, others), 1).held == 6ms);
}

TEST_CASE(
    "Frame without a plan has lost what it took beyond the usual, to others as far as they "
    "executed",
    "[observe][lost_time]") {
    FramesWork own = frame({{10ms, 40ms, 1ms}});
    own.longer = 10ms;
    const std::vector<OthersSegment> others = {segment(1, kSooner, {{10ms, 40ms, 4ms}})};
    CHECK(lost_time(own, others).by_itself == 6ms);
    CHECK(to(lost_time(own, others), 1).by_urgent == 4ms);
    own.longer = 3ms;
    CHECK(lost_time(own, others).by_itself == 0ms);
    CHECK(to(lost_time(own, others), 1).by_urgent == 3ms);
    own.longer = 10ms;
    CHECK(lost_time(own, {}).by_itself == 10ms);
    own.beside_bystanders = true;
    CHECK(lost_time(own, {}).by_itself == 0ms);
    CHECK(to(lost_time(own, {}), -1).by_urgent == 10ms);
}

TEST_CASE("What segments take beside kernels, alone, is no loss", "[observe][lost_time]") {
    FramesWork own = frame({{10ms, 20ms, 2ms}});  // a copy behind its kernels takes 7 ms
    CHECK(lost_time(own, {}).by_itself == 8ms);
    own.gaps = 7ms;
    CHECK(lost_time(own, {}).by_itself == 1ms);
}

TEST_CASE("Forgotten segments lost what the known ones say, in proportion",
          "[observe][lost_time]") {
    FramesWork own = frame({{10ms, 16ms, 2ms}, {16ms, 18ms, 1ms}});
    const std::vector<OthersSegment> others = {segment(1, kSooner, {{10ms, 15ms, 5ms}})};
    CHECK(lost_time(own, others).by_itself == 3ms);
    CHECK(to(lost_time(own, others), 1).by_urgent == 2ms);
    own.all_longer = 30ms;
    CHECK(is_about(lost_time(own, others).by_itself, 18ms));
    CHECK(is_about(to(lost_time(own, others), 1).by_urgent, 12ms));
    own.all_longer = 1ms;  // at least what is known
    CHECK(lost_time(own, others).by_itself == 3ms);
    own.all_longer = 30ms;
    own.pieces.clear();
    CHECK(lost_time(own, {}).by_itself == 30ms);
}

TEST_CASE("Forgotten holds count for whom the others were behind most", "[observe][lost_time]") {
    FramesWork own = frame({});
    own.held_before = 50ms;
    CHECK(to(lost_time(own, {}), observe::kUnknownChain).held == 50ms);
    own.holds = {{10ms, 12ms, 1}, {12ms, 15ms, 2}};
    CHECK(to(lost_time(own, {}), 1).held == 2ms);
    CHECK(to(lost_time(own, {}), 2).held == 53ms);
}

TEST_CASE("Hold behind a chain that is not known is none behind work of no chain",
          "[observe][lost_time]") {
    FramesWork own = frame({{10ms, 20ms, 10ms}, {20ms, 30ms, 2ms}});
    own.holds = {{30ms, 40ms}};
    own.beside_bystanders = true;
    const auto lost = lost_time(own, {segment(1, kSooner, {{30ms, 34ms, 4ms}})});
    CHECK(to(lost, observe::kUnknownChain).held == 6ms);
    CHECK(to(lost, observe::kNoChain).held == 0ms);
    CHECK(to(lost, observe::kNoChain).by_urgent == 8ms);
    CHECK(to(lost, 1).held == 4ms);
}

namespace {

/// Equal pieces from 10 ms to 110 ms, which take three times as long as planned.
std::vector<ExecutedPiece> pieces_of_100_ms(int count) {
    std::vector<ExecutedPiece> pieces;
    const nanoseconds each = 100'000us / count;
    for (int i = 0; i < count; ++i)
        pieces.push_back({10ms + i * each, 10ms + (i + 1) * each, each / 3});
    return pieces;
}

}  // namespace

TEST_CASE("However many pieces meet, no more of them are compared than there is time for",
          "[observe][lost_time]") {
    // 255 others with 16 segments each, of 1,000 pieces in all.
    FramesWork own = frame(pieces_of_100_ms(1000));
    for (int i = 0; i < 128; ++i) own.holds.push_back({110ms + i * 1ms, 111ms + i * 1ms, 1});
    std::vector<OthersSegment> others;
    for (int chain = 1; chain <= 255; ++chain) {
        const auto all = pieces_of_100_ms(1000);
        for (int i = 0; i < 16; ++i)
            others.push_back(
                segment(chain, kSooner, {all.begin() + i * 62, all.begin() + (i + 1) * 62}));
        others.push_back(segment(chain, kSooner, {{110ms, 238ms, 10ms}}));
    }
    const auto lost = lost_time(own, others);
    CHECK(lost.pairs_of_pieces > 0);
    CHECK(lost.pairs_of_pieces <= 3 * observe::kManyPairs);
    CHECK(lost.pairs_of_holds <= observe::kMostPairs);
    // And what was lost is found all the same.
    nanoseconds taken{0};
    for (const LostTo& its : lost.others) taken += its.taken();
    CHECK(taken > 64ms);
    CHECK(taken < 67ms);

    SECTION("nor where own pieces overlap") {
        for (ExecutedPiece& piece : own.pieces) piece.end = 1s;
        CHECK(lost_time(own, others).pairs_of_pieces <= observe::kMostPairs);
    }
    SECTION("where there are not that many, none is joined") {
        own.pieces = pieces_of_100_ms(500);
        others.clear();
        for (int chain = 1; chain <= 10; ++chain)
            others.push_back(segment(chain, kSooner, pieces_of_100_ms(500)));
        CHECK(lost_time(own, others).pairs_of_pieces == 2 * 10 * 500);
    }
}
