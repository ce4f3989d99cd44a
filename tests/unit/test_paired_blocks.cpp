// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/compare/paired_blocks.h"

#include <algorithm>
#include <random>

#include "tests/support/catch.h"
#include "tools/urgengo/compare/frame_blocks.h"

using namespace urgengo;
using namespace std::chrono_literals;
using cli::BlockPair;
using cli::Difference;
using cli::FrameBlocks;
using Measure = cli::FrameBlocks::Measure;

namespace {

constexpr int kFramesOfBlock = 40;

/// Latencies, each mostly like the one before, with a drift over all of them.
class Series {
  public:
    Series(std::mt19937& random, double memory) : random_(random), memory_(memory) {}
    double next() {
        last_ = memory_ * last_ + std::normal_distribution<>(0, 1)(random_);
        return last_ + 0.002 * ++frames_;
    }

  private:
    std::mt19937& random_;
    const double memory_;
    double last_ = 0;
    int frames_ = 0;
};

/// @param late_above  not 0: a block's number is its share of frames beyond that
std::vector<BlockPair> run(std::mt19937& random, int pairs, double memory, double difference,
                           double late_above = 0) {
    Series series(random, memory);
    const auto block = [&](double add) {
        double sum = 0;
        for (int i = 0; i < kFramesOfBlock; ++i) {
            const double value = series.next() + add;
            sum += late_above > 0 ? (value > late_above ? 1 : 0) : value;
        }
        return sum / kFramesOfBlock;
    };
    std::vector<BlockPair> all;
    for (int i = 0; i < pairs; ++i) {
        BlockPair pair;
        if (random() % 2 == 0) {
            pair.a = block(0);
            pair.b = block(difference);
        } else {
            pair.b = block(difference);
            pair.a = block(0);
        }
        all.push_back(pair);
    }
    return all;
}

/// As if each frame told something by itself.
bool naively_covers(const std::vector<BlockPair>& pairs, double truth) {
    double mean = 0;
    for (const BlockPair& pair : pairs)
        mean += (pair.b - pair.a) / static_cast<double>(pairs.size());
    const double error = std::sqrt(2.0 / (kFramesOfBlock * static_cast<double>(pairs.size())));
    return std::abs(mean - truth) < 1.96 * error;
}

}  // namespace

TEST_CASE("Interval covers the difference in 95 % of runs, however frames hang together",
          "[cli][compare]") {
    const auto [pairs, memory, runs] = GENERATE(table<int, double, int>(
        {{6, 0.9, 1500}, {10, 0.0, 1500}, {10, 0.98, 1500}, {20, 0.95, 400}}));
    std::mt19937 random(7);
    int covered = 0, found = 0, naive = 0;
    constexpr double kTruth = 0.4;
    for (int i = 0; i < runs; ++i) {
        const auto pairs_of_run = run(random, pairs, memory, kTruth);
        const auto is = cli::difference(pairs_of_run, 0.95, random());
        REQUIRE(is);
        covered += is->low <= kTruth && kTruth <= is->high;
        naive += naively_covers(pairs_of_run, kTruth);
        const auto none = cli::difference(run(random, pairs, memory, 0), 0.95, random());
        found += none->p <= 0.05;
        CHECK((none->p <= 0.05) == (none->low > 0 || none->high < 0));
    }
    INFO(pairs << " pairs, memory " << memory);
    const double coverage = static_cast<double>(covered) / runs;
    CHECK(coverage > 0.93);
    CHECK(coverage < 0.985);
    CHECK(static_cast<double>(found) / runs < 0.07);
    if (memory >= 0.9) CHECK(static_cast<double>(naive) / runs < 0.6);
}

TEST_CASE("No difference is found between miss ratios of the same, be misses frequent or rare",
          "[cli][compare]") {
    const double late_above = GENERATE(1.0, 6.0);
    std::mt19937 random(11);
    int found = 0;
    constexpr int kRuns = 1000;
    for (int i = 0; i < kRuns; ++i)
        found += cli::difference(run(random, 10, 0.9, 0, late_above), 0.95, 1)->p <= 0.05;
    CHECK(found < 70);
}

TEST_CASE("Large difference is found, and its interval is about it", "[cli][compare]") {
    std::mt19937 random(3);
    const auto is = cli::difference(run(random, 12, 0.5, 2), 0.95, 1);
    CHECK(is->p < 0.01);
    CHECK(is->low > 1);
    CHECK(is->high < 3);
    CHECK(is->mean() == Approx(2).margin(0.7));
}

TEST_CASE("Interval of six pairs is from the least to the largest mean", "[cli][compare]") {
    std::vector<BlockPair> pairs;
    for (const double b : {1.0, 2.0, 3.0, 4.0, 5.0, 6.0}) pairs.push_back({0, b});
    const auto is = cli::difference(pairs, 0.95, 1);
    REQUIRE(is);
    CHECK(is->low == 1);
    CHECK(is->high == 6);
    CHECK(is->p == Approx(2.0 / 64));
    pairs.pop_back();
    CHECK_FALSE(cli::difference(pairs, 0.95, 1));
    CHECK_FALSE(cli::difference({}, 0.95, 1));
}

TEST_CASE("Pairs that do not differ tell of no difference", "[cli][compare]") {
    const auto pairs = GENERATE(std::size_t{6}, std::size_t{30});
    const auto is = cli::difference(std::vector<BlockPair>(pairs, {0.25, 0.25}), 0.95, 1);
    REQUIRE(is);
    CHECK(is->p == 1);
    CHECK(is->low == 0);
    CHECK(is->high == 0);
}

TEST_CASE("Differences that are told together are adjusted in their order", "[cli][compare]") {
    std::vector<Difference> all(4);
    const double p[] = {0.04, 0.01, 0.5, 0.02};
    std::vector<Difference*> together;
    for (std::size_t i = 0; i < 4; ++i) {
        all[i].p = p[i];
        together.push_back(&all[i]);
    }
    cli::adjust(together);
    CHECK(all[1].adjusted_p == Approx(0.04));
    CHECK(all[3].adjusted_p == Approx(0.06));
    CHECK(all[0].adjusted_p == Approx(0.08));
    CHECK(all[2].adjusted_p == Approx(0.5));
}

TEST_CASE("One of twenty comparisons of many chains finds a difference where there is none",
          "[cli][compare]") {
    std::mt19937 random(5);
    int found = 0;
    constexpr int kRuns = 200;
    for (int i = 0; i < kRuns; ++i) {
        std::vector<Difference> all;
        for (int chain = 0; chain < 10; ++chain)
            all.push_back(*cli::difference(run(random, 10, 0.9, 0), 0.95, 1));
        std::vector<Difference*> together;
        for (Difference& each : all) together.push_back(&each);
        cli::adjust(together);
        found += std::any_of(all.begin(), all.end(),
                             [](const Difference& each) { return each.adjusted_p <= 0.05; });
    }
    CHECK(found <= 18);
}

namespace {

struct Blocks : FrameBlocks {
    Blocks() : FrameBlocks(2, 100ms) {}
    void block(bool is_b, nanoseconds begin, nanoseconds end, double cpu_s = 0) {
        FrameBlocks::begin(is_b, begin).end = end;
        last().cpu_s = cpu_s;
    }
    using nanoseconds = std::chrono::nanoseconds;
};

}  // namespace

TEST_CASE("Frame counts for the block that it was in from its begin to its end", "[cli][compare]") {
    Blocks blocks;
    blocks.block(false, 1s, 2s);
    blocks.block(true, 2010ms, 3s);
    const auto add = [&](std::chrono::nanoseconds begin, std::chrono::nanoseconds end) {
        blocks.add(0, {begin, end, end - begin > 50ms});
    };
    add(900ms, 950ms);    // before
    add(1050ms, 1080ms);  // the block has just begun
    add(1100ms, 1150ms);  // in time
    add(1300ms, 1400ms);  // late
    add(1950ms, 2050ms);  // spans the switch
    add(2005ms, 2050ms);  // while it was being switched
    add(2200ms, 2260ms);  // late, in the second
    add(2950ms, 3001ms);  // beyond the end
    CHECK(blocks.of(0, 0).frames == 2);
    CHECK(blocks.of(0, 0).missed == 1);
    CHECK(blocks.of(0, 0).latency_ms() == 75);
    CHECK(blocks.of(1, 0).frames == 1);
    CHECK(blocks.of(1, 0).missed == 1);
    CHECK(blocks.of(0, 1).frames == 0);
    const auto pairs = blocks.pairs(0, Measure::kMissRatio);
    REQUIRE(pairs.size() == 1);
    CHECK(pairs[0].a == 0.5);
    CHECK(pairs[0].b == 1);
    CHECK(blocks.pairs(1, Measure::kLatency).empty());
    CHECK(blocks.total(0, false).frames == 2);
}

TEST_CASE("Pair counts if both of its blocks are whole, in whatever order they came",
          "[cli][compare]") {
    Blocks blocks;
    blocks.block(true, 1s, 2s, 0.5);
    blocks.block(false, 2s, 4s, 0.5);
    blocks.block(false, 4s, 5s, 1);
    blocks.block(true, 5s, 6s, 1);
    blocks.last().is_broken = true;
    blocks.block(true, 6s, 7s);
    for (const auto second : {1s, 2s, 4s, 5s, 6s})
        blocks.add(1, {second + 200ms, second + (second == 1s ? 230ms : 210ms), false});
    const auto latencies = blocks.pairs(1, Measure::kLatency);
    REQUIRE(latencies.size() == 1);
    CHECK(latencies[0].a == 10);
    CHECK(latencies[0].b == 30);
    const auto cpu = blocks.pairs_of_cpu();
    REQUIRE(cpu.size() == 1);
    CHECK(cpu[0].a == 0.25);
    CHECK(cpu[0].b == 0.5);
    const auto all = blocks.pairs_of_all(Measure::kLatency, {100, 50});
    REQUIRE(all.size() == 1);
    CHECK(all[0].b == Approx(0.6));
}
