// SPDX-License-Identifier: Apache-2.0
#include "host/observe/miss_cause.h"

#include <random>

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using observe::Cause;
using observe::cause_of;
using observe::FrameFacts;
using observe::in_words;
using observe::LostTo;
using observe::MissCause;
using std::chrono::nanoseconds;

namespace {

/// A frame that is late by 5 ms.
FrameFacts late_frame() {
    FrameFacts facts;
    facts.deadline = 50ms;
    facts.latency = 55ms;
    return facts;
}

/// The chain's part of what the frame lost.
LostTo& lost_to(FrameFacts& facts, int chain) {
    for (LostTo& lost : facts.lost_to)
        if (lost.chain == chain) return lost;
    return facts.lost_to.emplace_back(LostTo{.chain = chain});
}

}  // namespace

TEST_CASE("Frame in time has no cause, whatever took longer", "[observe][miss_cause]") {
    FrameFacts facts = late_frame();
    facts.latency = facts.deadline;
    facts.cpu_longer = 20ms;
    facts.was_off = true;
    CHECK(cause_of(facts).kind == MissCause::kNone);
}

TEST_CASE("Late frame's cause is what took the most longer than it should",
          "[observe][miss_cause]") {
    FrameFacts facts = late_frame();
    facts.began_late = 2ms;
    facts.cpu_longer = 3ms;
    CHECK(cause_of(facts).kind == MissCause::kCpuLonger);
    CHECK(cause_of(facts).amount == 3ms);
    facts.began_late = 4ms;
    CHECK(cause_of(facts).kind == MissCause::kArrivedLate);
    facts.gpu_longer = 6ms;
    CHECK(cause_of(facts).kind == MissCause::kGpuLonger);
    CHECK(cause_of(facts).behind == -1);
    lost_to(facts, 3).held += 7ms;
    lost_to(facts, 1).held += 5ms;
    CHECK(cause_of(facts).kind == MissCause::kHeld);
    CHECK(cause_of(facts).behind == 3);
    CHECK(cause_of(facts).amount == 7ms);
}

TEST_CASE("Cause is not known when all that took longer is a small part of the lateness",
          "[observe][miss_cause]") {
    FrameFacts facts = late_frame();
    facts.cpu_longer = 1ms;
    lost_to(facts, 2).held += 500us;
    CHECK(cause_of(facts).kind == MissCause::kUnknown);
    CHECK(cause_of(facts).amount == 0ms);
    facts.cpu_longer = 1300us;
    CHECK(cause_of(facts).kind == MissCause::kCpuLonger);
}

TEST_CASE("Many chains that took a small part each are a cause together, told by the largest",
          "[observe][miss_cause]") {
    FrameFacts facts = late_frame();
    for (const int chain : {1, 2, 3, 4}) lost_to(facts, chain).held = 300us;
    CHECK(cause_of(facts).kind == MissCause::kUnknown);  // 1.2 ms of 5
    for (const int chain : {5, 6, 7}) lost_to(facts, chain).held = 300us;
    lost_to(facts, 6).by_kernel = 500us;
    CHECK(cause_of(facts).kind == MissCause::kKernelInFront);
    CHECK(cause_of(facts).behind == 6);
    CHECK(cause_of(facts).amount == 500us);
    facts.cpu_longer = 1300us;  // a fair part by itself
    CHECK(cause_of(facts).kind == MissCause::kCpuLonger);
}

TEST_CASE("Chain that took the most is named, by what it took the most by",
          "[observe][miss_cause]") {
    FrameFacts facts = late_frame();
    facts.gpu_longer = 6ms;
    SECTION("its own kernels, where each chain took less") {
        lost_to(facts, 4).by_urgent = 5ms;
        lost_to(facts, 5).by_urgent = 5ms;
        CHECK(cause_of(facts).kind == MissCause::kGpuLonger);
        CHECK(cause_of(facts).amount == 6ms);
    }
    SECTION("all that a chain took counts as one") {
        lost_to(facts, 5) = {.chain = 5, .by_urgent = 1ms, .by_kernel = 4ms, .by_priority = 3ms};
        CHECK(cause_of(facts).kind == MissCause::kKernelInFront);
        CHECK(cause_of(facts).behind == 5);
        CHECK(cause_of(facts).amount == 8ms);
        lost_to(facts, 5).by_priority = 5ms;
        CHECK(cause_of(facts).kind == MissCause::kPriorityLate);
        lost_to(facts, 5).by_urgent = 9ms;
        CHECK(cause_of(facts).kind == MissCause::kShared);
    }
    SECTION("being held behind it is another") {
        lost_to(facts, 5) = {.chain = 5, .held = 7ms, .by_urgent = 5ms};
        CHECK(cause_of(facts).kind == MissCause::kHeld);
        CHECK(cause_of(facts).behind == 5);
    }
    SECTION("work of no chain") {
        lost_to(facts, -1).by_urgent = 7ms;
        CHECK(cause_of(facts).kind == MissCause::kShared);
        CHECK(cause_of(facts).behind == -1);
    }
    SECTION("work that it waited for") {
        lost_to(facts, 2).waited = 9ms;
        lost_to(facts, 4).by_urgent = 7ms;
        CHECK(cause_of(facts).kind == MissCause::kWaited);
        CHECK(cause_of(facts).behind == 2);
    }
}

TEST_CASE("Instance that was given up is late for that, unless it was for times of its own",
          "[observe][miss_cause]") {
    FrameFacts facts = late_frame();
    facts.given_up.emplace();
    CHECK(cause_of(facts).kind == MissCause::kGivenUp);
    CHECK(cause_of(facts).behind == -1);
    CHECK(cause_of(facts).detail == 0);
    lost_to(facts, 1).held += 20ms;
    CHECK(cause_of(facts).behind == 1);  // where nothing better is known
    facts.given_up = sched::GivenUp{.itself = false, .chain = 2, .short_by = 3400us};
    Cause cause = cause_of(facts);
    CHECK(cause.kind == MissCause::kGivenUp);
    CHECK(cause.behind == 2);
    CHECK(observe::short_by(cause.kind, cause.detail) == 3400us);
    CHECK(in_words(cause.kind, "camera", cause.detail) ==
          "given up for camera, which else would have been late by 3.4 ms");
    facts.given_up = sched::GivenUp{.itself = true, .chain = 0, .short_by = 20s};
    cause = cause_of(facts);
    CHECK(cause.kind == MissCause::kGivenUpItself);
    CHECK(cause.behind == 1);
    CHECK(observe::short_by(cause.kind, cause.detail) == 655'350us);  // saturated
    facts.given_up->short_by = 1200us;
    cause = cause_of(facts);
    CHECK(in_words(cause.kind, "camera", cause.detail) ==
          "given up beside camera, as its own time did not fit by 1.2 ms");
    facts.cpu_longer = 6ms;
    CHECK(cause_of(facts).kind == MissCause::kCpuLonger);
    CHECK(cause_of(facts).detail == 0);
}

TEST_CASE("Frame that UrgenGo did not schedule, or ended early, is late for that",
          "[observe][miss_cause]") {
    FrameFacts facts = late_frame();
    facts.cpu_longer = 30ms;
    facts.was_off = true;
    CHECK(cause_of(facts).kind == MissCause::kOff);
    facts.exited = 7ms;
    facts.latency = 10ms;
    const Cause cause = cause_of(facts);
    CHECK(cause.kind == MissCause::kEndedEarly);
    CHECK(in_words(cause.kind, "", cause.detail) == "ended early, as it lacked 7.0 ms");
}

TEST_CASE("Longer GPU time is told as a factor of what it should have taken",
          "[observe][miss_cause]") {
    FrameFacts facts = late_frame();
    facts.gpu_longer = 10ms;
    CHECK(cause_of(facts).detail == 0);  // of what is not known
    facts.gpu_expected = 10ms;
    facts.gpu_longer = 8ms;
    lost_to(facts, 4).by_urgent = 2ms;
    Cause cause = cause_of(facts);
    CHECK(cause.kind == MissCause::kGpuLonger);
    CHECK(observe::times_as_long(cause.kind, cause.detail) == 1.8);
    CHECK(in_words(cause.kind, "", cause.detail) == "GPU longer than profiled: 1.8 times as long");
    CHECK(in_words(cause.kind, "") == "GPU longer than profiled");
    CHECK(observe::short_by(cause.kind, cause.detail) == 0ms);
    facts.gpu_longer = 50s;
    CHECK(observe::times_as_long(MissCause::kGpuLonger, cause_of(facts).detail) == 655.35);
    lost_to(facts, 1).held += 60s;  // what comes before it has no factor
    CHECK(cause_of(facts).detail == 0);
}

TEST_CASE("Frame whose threads slept longer than they should waited for something outside",
          "[observe][miss_cause]") {
    FrameFacts facts = late_frame();
    facts.cpu_longer = 3ms;
    facts.outside = 4ms;
    CHECK(cause_of(facts).kind == MissCause::kOutside);
    CHECK(cause_of(facts).amount == 4ms);
    CHECK(std::string(observe::to_word(MissCause::kOutside)) == "outside");
    facts.cpu_longer = 5ms;
    CHECK(cause_of(facts).kind == MissCause::kCpuLonger);
}

TEST_CASE("Usual time moves along, and one that is far from it moves it little",
          "[observe][miss_cause]") {
    observe::Usual usual;
    CHECK(usual.saw(10ms) == 0ms);
    CHECK(usual.saw(10ms) == 0ms);
    CHECK(usual.saw(18ms) == 8ms);
    CHECK(usual.saw(11ms) == 0ms);
    CHECK(usual.saw(5s) > 4900ms);
    CHECK(usual.saw(20ms) > 4ms);
}

TEST_CASE("Cause that was injected among what happens anyway is named", "[observe][miss_cause]") {
    const std::uint32_t seed = std::random_device()();
    INFO("seed " << seed);
    std::mt19937 random(seed);
    const auto up_to = [&](nanoseconds most) {
        return nanoseconds(
            static_cast<std::int64_t>(random() % static_cast<unsigned long>(most.count())));
    };
    constexpr MissCause kInjected[] = {MissCause::kArrivedLate, MissCause::kCpuLonger,
                                       MissCause::kGpuLonger, MissCause::kHeld,
                                       MissCause::kKernelInFront};
    for (const MissCause injected : kInjected) {
        int right = 0;
        for (int i = 0; i < 1000; ++i) {
            FrameFacts facts;
            facts.deadline = 50ms;
            facts.began_late = up_to(1ms);
            facts.cpu_longer = up_to(2ms);
            facts.gpu_longer = up_to(2ms);
            lost_to(facts, static_cast<int>(random() % 3)).held += up_to(2ms);
            lost_to(facts, 1).by_kernel += up_to(1ms);
            const nanoseconds more = 8ms + up_to(20ms);
            if (injected == MissCause::kArrivedLate) facts.began_late += more;
            if (injected == MissCause::kCpuLonger) facts.cpu_longer += more;
            if (injected == MissCause::kGpuLonger) facts.gpu_longer += more;
            if (injected == MissCause::kHeld) lost_to(facts, 2).held += more;
            if (injected == MissCause::kKernelInFront) lost_to(facts, 2).by_kernel += more;
            facts.latency = facts.deadline + more / 2;
            right += cause_of(facts).kind == injected;
        }
        INFO(observe::to_word(injected));
        CHECK(right >= 990);
    }
}

TEST_CASE("Every cause has a word and is told in words", "[observe][miss_cause]") {
    for (std::size_t i = 0; i < observe::kNumCauses; ++i) {
        const auto cause = static_cast<MissCause>(i);
        if (cause != MissCause::kUnknown) {
            CHECK(std::string(observe::to_word(cause)) != "unknown");
            CHECK(observe::in_words(cause, "lidar") != "unknown");
        }
    }
    CHECK(std::string(observe::to_word(static_cast<MissCause>(99))) == "unknown");
    CHECK(observe::in_words(MissCause::kHeld, "lidar") == "held behind lidar");
    CHECK(observe::in_words(MissCause::kShared, "") == "the GPU worked for programs of no chain");
}

TEST_CASE("Hold behind a chain that is not known is told without one", "[observe][miss_cause]") {
    FrameFacts facts = late_frame();
    lost_to(facts, observe::kUnknownChain).held = 4ms;
    lost_to(facts, observe::kNoChain).held = 3ms;
    CHECK(cause_of(facts).kind == MissCause::kHeld);
    CHECK(cause_of(facts).amount == 4ms);
    CHECK(cause_of(facts).behind == -1);
    CHECK(observe::in_words(MissCause::kHeld, "") == "held behind others");
}
