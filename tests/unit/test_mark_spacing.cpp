// SPDX-License-Identifier: Apache-2.0
#include "host/model/mark_spacing.h"

#include <random>
#include <vector>

#include "tests/support/catch.h"

using namespace std::chrono_literals;
using namespace urgengo::model;

namespace {

MarkSpacing even() {
    MarkSpacing spacing;
    spacing.dither = 0;
    return spacing;
}

MarkBudget full(const MarkSpacing& spacing) {
    MarkBudget budget;
    budget.earn(spacing, 1s);
    return budget;
}

// Deep in a chain that has time: nothing special.
MarkSituation ordinary(nanoseconds since_mark, nanoseconds next = 10us) {
    MarkSituation at;
    at.since_mark = since_mark;
    at.last_launch = 10us;
    at.next_launch = next;
    at.to_segment_end = 10ms;
    at.laxity = at.remaining = 100ms;
    return at;
}

struct Marked {
    int marks = 0;
    nanoseconds work{0}, longest_gap{0};
    int ends = 0, marked_ends = 0;
    nanoseconds spent(const MarkSpacing& spacing) const { return marks * spacing.cost; }
};

// Launches instances of segments of kernels, and marks them as told.
Marked mark_all(const MarkSpacing& spacing, const std::vector<nanoseconds>& segment,
                int num_segments, nanoseconds laxity_at_end) {
    Marked result;
    MarkBudget budget;
    nanoseconds total{0};
    for (nanoseconds k : segment) total += k;
    nanoseconds since{0};
    for (int s = 0; s < num_segments; ++s) {
        nanoseconds left = total;
        for (std::size_t i = 0; i < segment.size(); ++i) {
            since += segment[i];
            left -= segment[i];
            result.work += segment[i];
            budget.earn(spacing, segment[i]);
            MarkSituation at;
            at.since_mark = since;
            at.last_launch = segment[i];
            at.at_segment_end = i + 1 == segment.size();
            at.next_launch = at.at_segment_end ? 0us : segment[i + 1];
            at.to_segment_end = left;
            at.remaining = left + (num_segments - 1 - s) * total;
            at.laxity = laxity_at_end;
            at.sequence = static_cast<std::uint32_t>(result.marks) + 1;
            result.longest_gap = std::max(result.longest_gap, since);
            result.ends += at.at_segment_end;
            if (!mark_is_due(spacing, at, budget)) continue;
            budget.spend(spacing);
            ++result.marks;
            result.marked_ends += at.at_segment_end;
            since = 0us;
        }
    }
    return result;
}

}  // namespace

TEST_CASE("Marks stand about `every` apart", "[model][mark_spacing]") {
    const MarkSpacing spacing = even();
    const MarkBudget budget = full(spacing);
    CHECK_FALSE(mark_is_due(spacing, ordinary(190us), budget));
    CHECK(mark_is_due(spacing, ordinary(195us), budget));  // the nearer place
    CHECK(mark_is_due(spacing, ordinary(200us), budget));
    CHECK_FALSE(mark_is_due(spacing, ordinary(0us), budget));
    const Marked m = mark_all(spacing, std::vector<nanoseconds>(1000, 10us), 1, 1s);
    CHECK(m.marks == 50);
    CHECK(m.longest_gap <= 205us);
}

TEST_CASE("Marks stand denser near an urgent chain's end", "[model][mark_spacing]") {
    const MarkSpacing spacing = even();
    MarkSituation at = ordinary(60us);
    CHECK(wanted_distance(spacing, at) == 200us);
    at.laxity = 500us;
    CHECK(wanted_distance(spacing, at) == 200us);  // urgent, but far from its end
    at.remaining = 1ms;
    CHECK(wanted_distance(spacing, at) == 100us);
    at.remaining = 100us;
    CHECK(wanted_distance(spacing, at) == 50us);
    CHECK(mark_is_due(spacing, at, full(spacing)));
    CHECK_FALSE(mark_is_due(spacing, ordinary(60us), full(spacing)));
    at.laxity = 50ms;
    CHECK(wanted_distance(spacing, at) == 200us);  // near its end, but not urgent
    at.laxity = -1ns;
    CHECK(wanted_distance(spacing, at) == 200us);  // past the point of no return
}

TEST_CASE("Marks stand before and behind a long kernel", "[model][mark_spacing]") {
    const MarkSpacing spacing = even();
    const MarkBudget budget = full(spacing);
    CHECK(mark_is_due(spacing, ordinary(20us, 100us), budget));
    CHECK_FALSE(mark_is_due(spacing, ordinary(20us, 99us), budget));
    MarkSituation behind = ordinary(100us);
    CHECK_FALSE(mark_is_due(spacing, behind, budget));
    behind.last_launch = 100us;
    CHECK(mark_is_due(spacing, behind, budget));
}

TEST_CASE("A segment's end has a mark, and none comes shortly before", "[model][mark_spacing]") {
    const MarkSpacing spacing = even();
    MarkSituation at = ordinary(210us);
    at.to_segment_end = 50us;
    CHECK_FALSE(mark_is_due(spacing, at, full(spacing)));
    at.to_segment_end = 51us;
    CHECK(mark_is_due(spacing, at, full(spacing)));
    at = ordinary(10us);
    at.at_segment_end = true;
    CHECK(mark_is_due(spacing, at, full(spacing)));
    CHECK(mark_is_due(spacing, at, MarkBudget{}));  // owed for
    const Marked m = mark_all(spacing, {50us, 30us, 60us, 80us}, 500, 1s);
    CHECK(m.marked_ends == m.ends);
}

TEST_CASE("Marks never take more than their share of the GPU", "[model][mark_spacing]") {
    std::mt19937 random(1);
    for (nanoseconds cost : {kProgrammaticMarkCost, kPlainMarkCost, nanoseconds(126us)}) {
        for (int i = 0; i < 200; ++i) {
            MarkSpacing spacing;
            spacing.cost = cost;
            spacing.every = nanoseconds(std::uniform_int_distribution<>(1'000, 400'000)(random));
            std::vector<nanoseconds> segment;
            const std::int64_t longest =
                std::uniform_int_distribution<std::int64_t>(1'000, 500'000)(random);
            for (int k = std::uniform_int_distribution<>(1, 80)(random); k > 0; --k)
                segment.push_back(
                    nanoseconds(std::uniform_int_distribution<std::int64_t>(500, longest)(random)));
            const Marked m = mark_all(spacing, segment, 100, nanoseconds(random() % 3'000'000));
            REQUIRE(static_cast<double>(m.spent(spacing).count()) <=
                    spacing.max_share * static_cast<double>(m.work.count()) +
                        static_cast<double>(MarkBudget::kMaxOwed * cost.count()));
            REQUIRE(m.marks > 0);
        }
    }
}

TEST_CASE("Marks fall between other launches in other instances", "[model][mark_spacing]") {
    const MarkSpacing spacing;
    const MarkBudget budget = full(spacing);
    int due_at_190 = 0, due_at_150 = 0, due_at_250 = 0;
    for (std::uint32_t sequence = 0; sequence < 1000; ++sequence) {
        const auto is_due = [&](nanoseconds since) {
            MarkSituation at = ordinary(since, 0us);
            at.sequence = sequence;
            return mark_is_due(spacing, at, budget);
        };
        due_at_150 += is_due(149us);
        due_at_190 += is_due(190us);
        due_at_250 += is_due(250us);
    }
    CHECK(due_at_150 == 0);
    CHECK(due_at_190 > 350);
    CHECK(due_at_190 < 450);
    CHECK(due_at_250 == 1000);
    const Marked m = mark_all(spacing, std::vector<nanoseconds>(1000, 10us), 1, 1s);
    CHECK(m.marks >= 45);
    CHECK(m.marks <= 55);
}

TEST_CASE("Marks that cost nothing are never too many", "[model][mark_spacing]") {
    MarkSpacing spacing;
    spacing.cost = 0ns;
    spacing.every = 1us;  // behind every kernel
    const Marked m = mark_all(spacing, std::vector<nanoseconds>(100, 3us), 10, 1s);
    CHECK(m.marks == 1000);
}
