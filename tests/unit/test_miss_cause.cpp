// SPDX-License-Identifier: Apache-2.0
#include "host/observe/miss_cause.h"

#include <random>

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using observe::Cause;
using observe::cause_of;
using observe::FrameFacts;
using observe::GpuWindow;
using observe::in_words;
using observe::MissCause;
using observe::taken_by;
using observe::TimeBehind;
using std::chrono::nanoseconds;

namespace {

/// A frame that is late by 5 ms.
FrameFacts late_frame() {
    FrameFacts facts;
    facts.deadline = 50ms;
    facts.latency = 55ms;
    return facts;
}

GpuWindow window(nanoseconds begin, nanoseconds end, nanoseconds deadline) {
    return {.begin = begin,
            .end = end,
            .gpu = end - begin,
            .deadline = deadline,
            .utilization = 1,
            .longest_kernel = 2ms};
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
    facts.held.add(3, 7ms);
    facts.held.add(1, 5ms);
    CHECK(cause_of(facts).kind == MissCause::kHeld);
    CHECK(cause_of(facts).behind == 3);
    CHECK(cause_of(facts).amount == 7ms);
}

TEST_CASE("Cause is not known when all that took longer is a small part of the lateness",
          "[observe][miss_cause]") {
    FrameFacts facts = late_frame();
    facts.cpu_longer = 1ms;
    facts.held.add(2, 500us);
    CHECK(cause_of(facts).kind == MissCause::kUnknown);
    CHECK(cause_of(facts).amount == 0ms);
    facts.cpu_longer = 1300us;
    CHECK(cause_of(facts).kind == MissCause::kCpuLonger);
}

TEST_CASE("What others took of a GPU segment is theirs, and only the rest its own",
          "[observe][miss_cause]") {
    FrameFacts facts = late_frame();
    facts.gpu_longer = 10ms;
    SECTION("more urgent work") {
        facts.shared.add(4, 8ms);
        CHECK(cause_of(facts).kind == MissCause::kShared);
        CHECK(cause_of(facts).behind == 4);
        CHECK(cause_of(facts).amount == 8ms);
    }
    SECTION("a kernel of less urgent work") {
        facts.kernels.add(5, 9ms);
        CHECK(cause_of(facts).kind == MissCause::kKernelInFront);
        CHECK(cause_of(facts).behind == 5);
    }
    SECTION("its own, where others took less") {
        facts.kernels.add(5, 2ms);
        CHECK(cause_of(facts).kind == MissCause::kGpuLonger);
        CHECK(cause_of(facts).amount == 8ms);
    }
    SECTION("its own, as far as its kernels take longer by themselves") {
        facts.gpu_by_factor = 9ms;
        facts.shared.add(4, 80ms);
        CHECK(cause_of(facts).kind == MissCause::kGpuLonger);
        CHECK(cause_of(facts).amount == 9ms);
    }
    SECTION("others, where they had more work on the GPU than they can be shown to have taken") {
        facts.kernels.add(5, 2ms);
        facts.beside = 30ms;
        CHECK(cause_of(facts).kind == MissCause::kKernelInFront);
        CHECK(cause_of(facts).amount == 10ms);
    }
    SECTION("nothing of work that fits beside it") {
        facts.beside = 30ms;
        CHECK(cause_of(facts).kind == MissCause::kGpuLonger);
        CHECK(cause_of(facts).amount == 10ms);
    }
    SECTION("no more than it took longer") {
        facts.shared.add(4, 80ms);
        CHECK(cause_of(facts).amount == 10ms);
    }
    SECTION("what it took longer, by the share that each of them had") {
        facts.shared.add(4, 12ms);
        facts.priority.add(5, 8ms);
        CHECK(cause_of(facts).kind == MissCause::kShared);
        CHECK(cause_of(facts).amount == 6ms);
    }
    SECTION("work of no chain") {
        facts.beside_bystanders = true;
        CHECK(cause_of(facts).kind == MissCause::kShared);
        CHECK(cause_of(facts).behind == -1);
    }
    SECTION("work that it waited for") {
        facts.waited.add(2, 9ms);
        facts.gpu_longer = 10ms;
        facts.shared.add(4, 5ms);
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
    facts.held.add(1, 20ms);
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
    facts.shared.add(4, 2ms);
    Cause cause = cause_of(facts);
    CHECK(cause.kind == MissCause::kGpuLonger);
    CHECK(observe::times_as_long(cause.kind, cause.detail) == 1.8);
    CHECK(in_words(cause.kind, "", cause.detail) == "GPU longer than profiled: 1.8 times as long");
    CHECK(in_words(cause.kind, "") == "GPU longer than profiled");
    CHECK(observe::short_by(cause.kind, cause.detail) == 0ms);
    facts.gpu_longer = 50s;
    CHECK(observe::times_as_long(MissCause::kGpuLonger, cause_of(facts).detail) == 655.35);
    facts.held.add(1, 60s);  // what comes before it has no factor
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

TEST_CASE("Work that goes before takes all of its time, work that goes behind one kernel",
          "[observe][miss_cause]") {
    const GpuWindow own = window(100ms, 120ms, 200ms);
    const auto before = taken_by(window(110ms, 150ms, 180ms), own);
    CHECK(before.by_urgent == 10ms);
    CHECK(before.by_kernel == 0ms);
    const auto behind = taken_by(window(110ms, 150ms, 220ms), own);
    CHECK(behind.by_urgent == 0ms);
    CHECK(behind.by_kernel == 2ms);
    CHECK(taken_by(window(90ms, 100ms, 180ms), own).by_urgent == 0ms);
    CHECK(taken_by(window(120ms, 130ms, 180ms), own).by_urgent == 0ms);
    CHECK(taken_by(window(99ms, 100500us, 220ms), own).by_kernel == 500us);
}

TEST_CASE("Work that goes behind takes all of its time where its priority was no smaller",
          "[observe][miss_cause]") {
    GpuWindow own = window(100ms, 120ms, 200ms), other = window(110ms, 150ms, 220ms);
    own.first_priority = own.last_priority = -3;
    other.first_priority = other.last_priority = -1;
    CHECK(taken_by(other, own).by_priority == 0ms);
    for (const auto& [own_last, other_first] : {std::pair{-1, -1}, std::pair{0, -1}}) {
        own.last_priority = own_last;
        other.first_priority = other_first;
        const auto taken = taken_by(other, own);
        CHECK(taken.by_kernel == 2ms);
        CHECK(taken.by_priority == 8ms);
    }
    FrameFacts facts = late_frame();
    facts.gpu_longer = 10ms;
    facts.kernels.add(4, 2ms);
    facts.priority.add(4, 8ms);
    CHECK(cause_of(facts).kind == MissCause::kPriorityLate);
    CHECK(cause_of(facts).behind == 4);
    CHECK(cause_of(facts).amount == 8ms);
}

TEST_CASE("Work that fits beside takes nothing", "[observe][miss_cause]") {
    GpuWindow own = window(100ms, 120ms, 200ms), other = window(100ms, 120ms, 180ms);
    own.utilization = other.utilization = 0.5;
    CHECK(taken_by(other, own).by_urgent == 0ms);
    other.utilization = 0.75;
    CHECK(taken_by(other, own).by_urgent == 5ms);
    other.utilization = 1;
    other.gpu = 4ms;  // the rest of its segment it launched, or waited
    CHECK(taken_by(other, own).by_urgent == 2ms);
}

TEST_CASE("Times by chain keep those with most, and the sum of all", "[observe][miss_cause]") {
    TimeBehind times;
    CHECK(times.longest().time == 0ms);
    for (int chain = 0; chain < 10; ++chain) times.add(chain, std::chrono::milliseconds(chain));
    times.add(9, 2ms);
    times.add(-1, 1ms);
    times.add(3, -5ms);
    CHECK(times.longest().chain == 9);
    CHECK(times.longest().time == 11ms);
    CHECK(times.total() == 48ms);
}

TEST_CASE("Times by chain keep the one with most, though it came last and in small pieces",
          "[observe][miss_cause]") {
    TimeBehind times;
    for (int chain = 0; chain < 4; ++chain) times.add(chain, 1ms);
    for (int i = 0; i < 200; ++i) times.add(4, 50us);
    CHECK(times.longest().chain == 4);
    CHECK(times.longest().time == 10ms);
    CHECK(times.total() == 14ms);

    TimeBehind frame;  // what its runs were held for adds up as well
    frame.add(times);
    frame.add(times);
    CHECK(frame.longest().chain == 4);
    CHECK(frame.longest().time == 20ms);
    CHECK(frame.total() == 28ms);

    FrameFacts facts = late_frame();
    facts.held = times;
    CHECK(cause_of(facts).kind == MissCause::kHeld);
    CHECK(cause_of(facts).behind == 4);
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
            facts.held.add(static_cast<int>(random() % 3), up_to(2ms));
            facts.kernels.add(1, up_to(1ms));
            const nanoseconds more = 8ms + up_to(20ms);
            if (injected == MissCause::kArrivedLate) facts.began_late += more;
            if (injected == MissCause::kCpuLonger) facts.cpu_longer += more;
            if (injected == MissCause::kGpuLonger) facts.gpu_longer += more;
            if (injected == MissCause::kHeld) facts.held.add(2, more);
            if (injected == MissCause::kKernelInFront) {
                facts.gpu_longer += more;
                facts.kernels.add(2, more);
            }
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
