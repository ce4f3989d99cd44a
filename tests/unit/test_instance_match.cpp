// SPDX-License-Identifier: Apache-2.0
//
// Counting what instance detection gets wrong: each kind of error, provoked.
#include "tests/support/catch.h"
#include "tools/bench/measure/instance_match.h"

using namespace urgengo::cli;
using namespace std::chrono_literals;
using std::chrono::nanoseconds;

namespace {

/// Arrives 5 ms before it begins, and takes 20 ms.
TrueFrame frame(nanoseconds begin) {
    return {begin - 5ms, begin, begin + 6us, begin + 20ms};
}

/// What a detector without errors makes of it.
DetectedInstance exact(nanoseconds begin) {
    return {begin - 5ms, begin + 2us, begin + 20ms - 1us, false, false};
}

const std::vector<TrueFrame> kFrames{frame(100ms), frame(200ms), frame(300ms), frame(400ms)};

std::vector<DetectedInstance> all_exact() {
    return {exact(100ms), exact(200ms), exact(300ms), exact(400ms)};
}

void check_counts(const InstanceMatch& match, std::uint64_t detected, std::uint64_t false_starts,
                  std::uint64_t missed_starts, std::uint64_t merged) {
    CHECK(match.frames == 4);
    CHECK(match.detected == detected);
    CHECK(match.false_starts == false_starts);
    CHECK(match.missed_starts == missed_starts);
    CHECK(match.merged == merged);
}

}  // namespace

TEST_CASE("Instances match when every frame is detected", "[unit][cli]") {
    auto detected = all_exact();
    detected[1].observed = true;
    detected[2].resync = true;
    std::swap(detected[0], detected[3]);  // in any order
    const InstanceMatch match = match_instances(kFrames, detected);
    check_counts(match, 4, 0, 0, 0);
    CHECK(match.observed == 1);
    CHECK(match.resyncs == 1);
    CHECK(match.begin_error_us == std::vector<double>(4, 2));
    CHECK(match.end_error_us == std::vector<double>(4, -1));
    CHECK(match.arrival_error_us == std::vector<double>(4, 0));
}

TEST_CASE("Instances have a missed start when a frame is not detected", "[unit][cli]") {
    check_counts(match_instances(kFrames, {exact(100ms), exact(300ms), exact(400ms)}), 3, 0, 1, 0);
    check_counts(match_instances(kFrames, {}), 0, 0, 4, 0);
}

TEST_CASE("Instances have a false start when a frame is split", "[unit][cli]") {
    auto detected = all_exact();
    detected[1].end = 210ms;
    detected.insert(detected.begin() + 2, {211ms, 211ms, 220ms, false, false});
    check_counts(match_instances(kFrames, detected), 5, 1, 0, 0);
}

TEST_CASE("Instances have a false start when there is no frame", "[unit][cli]") {
    auto detected = all_exact();
    detected.push_back({250ms, 250ms, 255ms, false, false});
    check_counts(match_instances(kFrames, detected), 5, 1, 0, 0);
    CHECK(match_instances({}, detected).false_starts == 5);
}

TEST_CASE("Instances have a false and a missed start when a begin is late", "[unit][cli]") {
    auto detected = all_exact();
    detected[1].begin += 1ms;
    check_counts(match_instances(kFrames, detected), 4, 1, 1, 0);
}

TEST_CASE("Instances have a false start when one frame begins twice", "[unit][cli]") {
    auto detected = all_exact();
    detected.push_back(exact(200ms));
    check_counts(match_instances(kFrames, detected), 5, 1, 0, 0);
}

TEST_CASE("Instances are merged when one covers several frames", "[unit][cli]") {
    auto detected = all_exact();
    detected.erase(detected.begin() + 1, detected.begin() + 3);
    detected[0].end = 320ms;
    const InstanceMatch match = match_instances(kFrames, detected);
    check_counts(match, 2, 0, 2, 1);
    CHECK(match.end_error_us.size() == 1);  // of the one that is not merged
}

TEST_CASE("Instances are merged when one begins late and runs into the next frame", "[unit][cli]") {
    auto detected = all_exact();
    detected.erase(detected.begin() + 2);
    detected[1].begin = 210ms;
    detected[1].end = 310ms;
    check_counts(match_instances(kFrames, detected), 3, 1, 2, 1);
}

TEST_CASE("Instances without an end last until the next begin", "[unit][cli]") {
    auto detected = all_exact();
    detected[1].end.reset();
    InstanceMatch match = match_instances(kFrames, detected);
    check_counts(match, 4, 0, 0, 0);
    CHECK(match.end_error_us.size() == 3);
    detected.pop_back();
    detected[2].end.reset();
    match = match_instances(kFrames, detected);
    check_counts(match, 3, 0, 1, 1);
}

TEST_CASE("Instances match when a first launch is held for long", "[unit][cli]") {
    auto frames = kFrames;
    frames[1].first_launched = 215ms;
    auto detected = all_exact();
    detected[1].begin = 207ms;
    const InstanceMatch match = match_instances(frames, detected);
    check_counts(match, 4, 0, 0, 0);
    CHECK(match.begin_error_us[1] == 7000);
}

TEST_CASE("Instances count from a later frame when the first are skipped", "[unit][cli]") {
    auto detected = all_exact();
    detected.erase(detected.begin());  // as while nothing is known yet
    detected.push_back({150ms, 150ms, 160ms, false, false});
    InstanceMatch match = match_instances(kFrames, detected, 1);
    CHECK(match.frames == 3);
    CHECK(match.detected == 3);
    CHECK(match.false_starts + match.missed_starts + match.merged == 0);
    match = match_instances(kFrames, detected, 9);
    CHECK(match.frames == 0);
    CHECK(match.detected == 0);
}

TEST_CASE("Matches add up over chains", "[unit][cli]") {
    InstanceMatch sum = match_instances(kFrames, {exact(100ms), exact(300ms), exact(400ms)});
    sum += match_instances(kFrames, all_exact());
    CHECK(sum.frames == 8);
    CHECK(sum.detected == 7);
    CHECK(sum.missed_starts == 1);
    CHECK(sum.begin_error_us == std::vector<double>(7, 2));
    CHECK(sum.end_error_us == std::vector<double>(7, -1));
    CHECK(sum.arrival_error_us == std::vector<double>(7, 0));
}
