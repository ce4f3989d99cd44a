// SPDX-License-Identifier: Apache-2.0
//
// How exact positions are, of programs made at random (host/model/position.h).
#include <algorithm>
#include <random>
#include <vector>

#include "host/model/position.h"
#include "tests/support/catch.h"
#include "tests/support/virtual_stream.h"

using namespace urgengo;
using namespace std::chrono_literals;
using model::locate;
using model::nanoseconds;
using model::Position;
using model::Tempo;
using testing::launch_instance;
using testing::VirtualInstance;
using testing::VirtualStream;

namespace {

// Kernels of 5 to 100 us; estimates off by up to `error` of the truth, all by the same or each by
// its own.
VirtualInstance random_instance(std::mt19937& random, std::size_t kernels, double error,
                                double bias = 1) {
    VirtualInstance instance;
    std::uniform_real_distribution<double> truth(5'000, 100'000), off(1 - error, 1 + error);
    for (std::size_t i = 0; i < kernels; ++i) {
        const double ns = truth(random);
        instance.truth.push_back(nanoseconds(static_cast<std::int64_t>(ns)));
        instance.estimates.push_back(
            nanoseconds(static_cast<std::int64_t>(ns * off(random) * bias)));
    }
    return instance;
}

// The position of launch `index` of the stream, whatever number its log began with.
std::uint32_t index_of(const VirtualStream& stream, const Position& p) {
    return p.launch - stream.first_launch();
}

// What must hold at any time, whatever the estimates are.
void check_bounds(const VirtualStream& stream, const Position& p) {
    const model::SeenMark seen = stream.seen();
    const std::uint32_t index = index_of(stream, p);
    std::uint32_t first = 0, end = stream.log.count() - stream.first_launch();
    for (const auto& m : stream.marks) {
        const bool done = static_cast<std::int32_t>(seen.sequence - m.sequence) >= 0;
        if (done) {
            first = m.launches;
        } else if (m.sequence == seen.sequence + 1 &&
                   static_cast<std::int32_t>(stream.log.last_mark() - m.sequence) >= 0) {
            end = m.launches;
            REQUIRE(index < end);
        }
    }
    REQUIRE(index >= first);
    REQUIRE(index <= end);
    REQUIRE(p.unexecuted >= 0ns);
    REQUIRE(p.uncertain >= 0ns);
}

struct Accuracy {
    int samples = 0, within_one = 0, exact = 0;
    std::vector<nanoseconds> left_errors;

    double share_within_one() const { return double(within_one) / samples; }
    nanoseconds left_error(double part) {
        std::sort(left_errors.begin(), left_errors.end());
        return left_errors[static_cast<std::size_t>(double(left_errors.size() - 1) * part)];
    }
};

// Looks at random times while there is work.
Accuracy sample(VirtualStream& stream, std::mt19937& random, const Tempo& tempo = {}) {
    Accuracy a;
    std::uniform_int_distribution<std::int64_t> step_ns(1'000, 60'000);
    nanoseconds now = stream.launches.front().call;
    while ((now += nanoseconds(step_ns(random))) < stream.gpu_free()) {
        stream.move_to(now);
        const auto p = locate(stream.log, stream.seen(), tempo, now);
        REQUIRE(p);
        check_bounds(stream, *p);
        const auto truth = static_cast<std::int64_t>(stream.truth(now));
        if (truth < static_cast<std::int64_t>(stream.launches.size()) &&
            stream.launches[static_cast<std::size_t>(truth)].call > now)
            continue;  // nothing to be at
        const std::int64_t off = std::int64_t{index_of(stream, *p)} - truth;
        ++a.samples;
        a.exact += off == 0;
        a.within_one += std::abs(off) <= 1;
        a.left_errors.push_back(std::chrono::abs(p->unexecuted - stream.truly_left(now)));
    }
    return a;
}

}  // namespace

TEST_CASE("Position is that of the executing kernel when estimates are right",
          "[model][position]") {
    std::mt19937 random(11);
    VirtualStream stream;
    nanoseconds now = 1ms;
    for (std::uint16_t i = 1; i <= 20; ++i) {
        VirtualInstance instance = random_instance(random, 50, 0);
        instance.instance = i;
        now = launch_instance(stream, instance, now + 1ms, random);
    }
    Accuracy a = sample(stream, random);
    CHECK(a.samples > 1000);
    CHECK(a.exact > 0.9 * a.samples);  // marks themselves take a little
    CHECK(a.share_within_one() == 1);
    CHECK(a.left_error(0.99) < 10us);
}

TEST_CASE("Position is within one kernel in 95 % when estimates are off by up to 30 %",
          "[model][position]") {
    for (std::uint32_t seed = 0; seed < 8; ++seed) {
        INFO("seed " << seed);
        std::mt19937 random(seed);
        VirtualStream stream;
        nanoseconds now = 1ms;
        for (std::uint16_t i = 1; i <= 40; ++i) {
            VirtualInstance instance = random_instance(random, 80, 0.3);
            instance.instance = i;
            now = launch_instance(stream, instance, now + 500us, random);
        }
        Accuracy a = sample(stream, random);
        CHECK(a.share_within_one() >= 0.95);
        CHECK(a.left_error(0.99) <= 200us);
    }
}

TEST_CASE("Position follows the pace when all estimates are off by the same", "[model][position]") {
    std::mt19937 random(12);
    for (double bias : {0.5, 0.77, 1.3, 2.0}) {
        INFO("estimates " << bias << " times the truth");
        VirtualStream stream;
        nanoseconds now = 1ms;
        for (std::uint16_t i = 1; i <= 20; ++i) {
            VirtualInstance instance = random_instance(random, 80, 0.1, bias);
            instance.instance = i;
            now = launch_instance(stream, instance, now + 500us, random);
        }
        Tempo tempo;
        tempo.pace = 1 / bias;
        CHECK(sample(stream, random, tempo).share_within_one() >= 0.97);
    }
}

TEST_CASE("Position is within its bounds whatever the estimates are", "[model][position]") {
    std::mt19937 random(13);
    for (double bias : {0.01, 0.1, 10.0, 100.0}) {
        VirtualStream stream;
        nanoseconds now = 1ms;
        for (std::uint16_t i = 1; i <= 5; ++i) {
            VirtualInstance instance = random_instance(random, 50, 0.9, bias);
            instance.instance = i;
            now = launch_instance(stream, instance, now + 500us, random);
            stream.others(now + 700us, now + 3ms);
        }
        CHECK(sample(stream, random).samples > 0);
    }
}
