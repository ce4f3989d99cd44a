// SPDX-License-Identifier: Apache-2.0
//
// Which marks a task's kernels are learned from, without a GPU.
#include "host/progress/learning.h"

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using progress::Learning;
using std::chrono::nanoseconds;

namespace {

/// A task that is marked behind each kernel of 100 us, which takes longer; the GPU's clock is the
/// host's.
struct Fixture {
    static constexpr std::uint64_t kKernel = 7;

    /// @returns whether the mark tells anything new
    bool execute(const Learning::Others& others = {}, nanoseconds took = 200us) {
        log.launched(100us, {.time = now, .kernel = kKernel, .position = sequence});
        log.marked(now, ++sequence);
        now += took;
        const auto stamp = static_cast<std::uint64_t>(now.count());
        line.clock = clock_kind;
        line.word[0] = ug_mark_word0(sequence, 0, sequence);
        line.word[1] = ug_mark_word1(stamp, sequence);
        clock.add({stamp, now - 1us, now + 1us});
        const auto mark = learning.new_mark(line, sequence);
        if (mark) learning.learn(*mark, clock, log, false, others);
        return mark.has_value();
    }
    std::optional<nanoseconds> known() { return learning.durations().find(0, kKernel); }

    model::TaskPlan plan;
    Learning learning{plan};
    model::LaunchLog log;
    model::GpuClock clock;
    ug_mark_line line{};
    std::uint32_t clock_kind = UG_MARK_CLOCK_GPU, sequence = 0;
    nanoseconds now{1s};
};

}  // namespace

TEST_CASE("Learning takes the time between two marks", "[progress][learning]") {
    Fixture f;
    CHECK(f.execute());
    CHECK_FALSE(f.known());                                // there is no mark before it
    CHECK_FALSE(f.learning.new_mark(f.line, f.sequence));  // once
    for (int i = 0; i < 8; ++i) CHECK(f.execute());
    REQUIRE(f.known());
    // Less the mark's own time, and what its clock leaves open.
    CHECK(*f.known() > 190us);
    CHECK(*f.known() < 200us);
}

TEST_CASE("Learning takes nothing from marks without a time of the GPU", "[progress][learning]") {
    Fixture f;
    f.clock_kind = UG_MARK_CLOCK_HOST;
    CHECK_FALSE(f.execute());
    CHECK_FALSE(f.execute());
    CHECK_FALSE(f.known());
}

TEST_CASE("Learning knows who was on the GPU between two marks", "[progress][learning]") {
    // Others that come and go show in the number of changes.
    const auto learned = [](bool are_there, bool changes) {
        Fixture f;
        for (int i = 0; i < 8; ++i) f.execute();
        for (std::uint32_t i = 1; i < 9; ++i) f.execute({changes ? i : 0, are_there}, 400us);
        return *f.known();
    };
    CHECK(learned(false, false) > 300us);
    CHECK(learned(true, false) < 210us);
    CHECK(learned(false, true) < 210us);
}

TEST_CASE("Learning forgets who was there before a segment, unless work was left",
          "[progress][learning]") {
    const auto learned = [](bool idle) {
        Fixture f;
        for (int i = 0; i < 8; ++i) f.execute();
        for (int i = 0; i < 8; ++i) {
            f.execute({0, true}, 200us);
            f.learning.segment_ended(idle);
            f.learning.segment_begins({0, false});
            f.execute({0, false}, 400us);
        }
        return *f.known();
    };
    CHECK(learned(true) > 250us);
    CHECK(learned(false) < 210us);
}
