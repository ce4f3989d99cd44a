// SPDX-License-Identifier: Apache-2.0
#include "host/model/durations.h"

#include <memory>
#include <vector>

#include "tests/support/catch.h"
#include "tests/support/virtual_stream.h"

using namespace urgengo;
using namespace std::chrono_literals;
using model::Durations;
using model::nanoseconds;
using testing::launch_instance;
using testing::VirtualInstance;
using testing::VirtualStream;

namespace {

// A log with so many launches of 10 us, put down long before marks ran.
struct Spans {
    Durations durations;
    std::unique_ptr<model::LaunchLog> log = std::make_unique<model::LaunchLog>();
    std::uint32_t next_position = 0;

    model::MeasuredSpan launch(std::uint32_t n, nanoseconds measured, bool shared = false,
                               std::uint64_t kernel = 0) {
        const std::uint32_t first = log->count();
        for (std::uint32_t i = 0; i < n; ++i) {
            const std::uint64_t k = kernel ? kernel : next_position + 1;
            log->launched(durations.find(next_position, k).value_or(10us),
                          {0ns, 0ns, k, next_position, 1});
            ++next_position;
        }
        return {first, log->count(), measured, shared, false};
    }
    void instance(std::uint32_t n, nanoseconds measured, bool shared = false,
                  std::uint64_t kernel = 0) {
        next_position = 0;
        durations.observe(*log, launch(n, measured, shared, kernel));
        durations.end_instance(n);
    }
    nanoseconds at(std::uint32_t position, std::uint64_t kernel) const {
        return durations.find(position, kernel).value_or(-1ns);
    }
};

Durations planned(std::uint32_t n, nanoseconds each) {
    std::vector<Durations::Planned> plan;
    for (std::uint32_t i = 0; i < n; ++i) plan.push_back({i + 1, each});
    return Durations(plan);
}

}  // namespace

TEST_CASE("Durations share a span out in proportion to the estimates", "[model][durations]") {
    Spans s;
    s.durations = Durations(std::vector<Durations::Planned>{{1, 10us}, {2, 30us}});
    s.instance(2, 44us);
    // By a tenth more each; a profile counts as one sample.
    CHECK(s.at(0, 1) == 10'500ns);
    CHECK(s.at(1, 2) == 31'500ns);
    CHECK(s.durations.remaining_from(0) == 42us);
    CHECK(s.durations.remaining_from(1) == 31'500ns);
    CHECK(s.durations.remaining_from(2) == 0ns);
}

TEST_CASE("Durations know nothing before they are told", "[model][durations]") {
    Spans s;
    CHECK_FALSE(s.durations.find(0, 1));
    CHECK(s.durations.remaining_from(0) == 0ns);
    s.instance(2, 50us);
    CHECK(s.at(0, 1) == 25us);
    CHECK(s.durations.num_launches() == 2);
    // By kernel and size where another position has it.
    CHECK(s.at(17, 2) == 25us);
    CHECK_FALSE(s.durations.find(17, 3));
}

TEST_CASE("Durations move by a bounded factor an instance", "[model][durations]") {
    Spans s;
    s.durations = planned(2, 10us);
    s.instance(2, 2s);
    CHECK(s.at(0, 1) == 12'500ns);
    s.instance(2, 1us);
    CHECK(s.at(0, 1) == 10us);
    // Many spans of the same kernel in one instance move it no further than one.
    s.next_position = 0;
    for (int i = 0; i < 50; ++i) {
        s.next_position = 0;
        s.durations.observe(*s.log, s.launch(2, 2s));
    }
    CHECK(s.at(0, 1) == 12'500ns);
}

TEST_CASE("Durations learn once from a span that has a kernel many times", "[model][durations]") {
    Spans s;
    for (int i = 0; i < 20; ++i) s.instance(10, 100us, false, 5);
    s.instance(10, 180us, false, 5);
    CHECK(s.at(17, 5) == 11us);  // an eighth of the way
}

TEST_CASE("Durations recover from a first instance that was ten times too long",
          "[model][durations]") {
    Spans s;
    s.instance(4, 400us);
    CHECK(s.at(0, 1) == 100us);
    for (int i = 0; i < 8; ++i) s.instance(4, 40us);
    CHECK(s.at(0, 1) < 15us);
}

TEST_CASE("Durations correct a profile that is off by two within a few instances",
          "[model][durations]") {
    Spans s;
    s.durations = planned(4, 10us);
    for (int i = 0; i < 4; ++i) s.instance(4, 80us);
    CHECK(s.at(0, 1) > 18us);
    CHECK(s.at(0, 1) <= 20us);
}

TEST_CASE("Durations take time shared with others for an upper bound", "[model][durations]") {
    Spans s;
    s.durations = planned(2, 10us);
    s.instance(2, 70us, true);
    CHECK(s.at(0, 1) == 10us);
    s.instance(2, 18us, true);  // within the margin: noise
    CHECK(s.at(0, 1) == 10us);
    s.instance(2, 12us, true);
    CHECK(s.at(0, 1) == 9'500ns);
    // Where nothing is known it is better than nothing, until there is more.
    Spans unknown;
    unknown.instance(1, 70us, true);
    CHECK(unknown.at(0, 1) == 70us);
    unknown.instance(1, 30us);
    CHECK(unknown.at(0, 1) == 30us);
    CHECK(unknown.at(17, 1) == 30us);
}

TEST_CASE("Durations do not count time in which the GPU waited for a launch",
          "[model][durations]") {
    VirtualStream stream;
    stream.launch(1ms, 100us, 100us, 0);
    stream.mark(1001us);
    for (std::uint32_t i = 1; i < 4; ++i) stream.launch(1010us, 100us, 100us, i);
    stream.mark(1010us);  // launched in time
    stream.launch(1010us, 100us, 100us, 4);
    stream.launch(3ms, 100us, 100us, 5);
    stream.mark(3ms);  // the last launch came late
    stream.launch(5ms, 100us, 100us, 6);
    stream.launch(5001us, 100us, 100us, 7);
    stream.mark(5002us);  // the first launch came late: the span begins with it
    stream.launch(6ms, 10us, 10us, 8);
    stream.mark(6ms);  // too short for that
    stream.move_to(10ms);
    const auto span = [&](std::size_t to, bool shared = false) {
        const auto stamped = [&](std::size_t i) {
            const auto& m = stream.marks[i];
            return model::StampedMark{m.sequence, stream.timer.stamp(m.run), m.run, 2us};
        };
        return model::span_between(stream.log, stamped(to - 1), stamped(to),
                                   VirtualStream::kMarkCost, shared);
    };
    const auto near = [](nanoseconds a, nanoseconds b) { return std::chrono::abs(a - b) < 100ns; };
    REQUIRE(span(1));
    CHECK(span(1)->is_own());
    CHECK(span(1)->first == 1);
    CHECK(span(1)->end == 4);
    CHECK(near(span(1)->measured, 300us));
    CHECK_FALSE(span(1, true)->is_own());
    CHECK(span(2)->late);
    CHECK(span(3)->is_own());
    CHECK(near(span(3)->measured, 200us));
    CHECK(span(4)->late);
    CHECK(span(4)->measured > 10us);
}

TEST_CASE("Durations tell when the profile no longer fits", "[model][durations]") {
    Spans s;
    s.durations = planned(4, 10us);
    for (std::uint32_t i = 1; i < Durations::kMisfitInstances; ++i) s.instance(4, 64us);
    CHECK(s.durations.profile_fit().fits);
    CHECK(s.durations.profile_fit().instances == Durations::kMisfitInstances - 1);
    s.instance(4, 64us);
    CHECK_FALSE(s.durations.profile_fit().fits);
    CHECK(s.durations.profile_fit().ratio == Approx(1.6));
    s.instance(4, 400us, true);  // shared time says nothing of it
    CHECK(s.durations.profile_fit().ratio == Approx(1.6));
    s.instance(4, 45us);
    CHECK(s.durations.profile_fit().fits);
    CHECK(s.durations.profile_fit().instances == 0);
    // Now too long, now too short is noise.
    for (int i = 0; i < 40; ++i) s.instance(4, i % 2 == 0 ? 80us : 20us);
    CHECK(s.durations.profile_fit().fits);
    for (int i = 0; i < 8; ++i) s.instance(4, 20us);
    CHECK_FALSE(s.durations.profile_fit().fits);
}

TEST_CASE("Durations let another kernel have a position after it stood there three times",
          "[model][durations]") {
    Spans s;
    s.durations = planned(1, 10us);
    s.instance(1, 50us, false, 99);
    s.instance(1, 50us, false, 99);
    CHECK(s.at(0, 1) == 10us);
    s.instance(1, 50us, false, 99);
    CHECK_FALSE(s.durations.find(0, 1));
    CHECK(s.at(0, 99) == 50us);
}

TEST_CASE("Durations keep their storage when kernels never end", "[model][durations]") {
    Spans s;
    for (std::uint64_t kernel = 1; kernel < 5'000; ++kernel) s.instance(1, 50us, false, kernel);
    CHECK_FALSE(s.durations.find(7, 4'999));
    CHECK(s.at(7, 384) == 50us);
    CHECK_FALSE(s.durations.find(7, 385));  // three quarters full
    s.durations.end_instance(0xffff'ffffu);
    CHECK(s.durations.num_launches() == Durations::kMaxPositions);
}

TEST_CASE("kernel_id tells kernels and sizes apart", "[model][durations]") {
    CHECK(model::kernel_id({5, 6, 7}) == model::kernel_id({5, 6, 7}));
    CHECK(model::kernel_id({5, 6, 7}) != model::kernel_id({5, 7, 6}));
    CHECK(model::kernel_id({5, 6, 7}) != model::kernel_id({6, 6, 7}));
    CHECK(model::kernel_id({}) != 0);
}
