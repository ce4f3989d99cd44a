// SPDX-License-Identifier: Apache-2.0
#include "host/model/fork_progress.h"

#include "tests/support/catch.h"

using namespace std::chrono_literals;
using urgengo::model::ForkExecuted;
using urgengo::model::ForkProgress;
using urgengo::model::nanoseconds;

namespace {

constexpr std::uint32_t kMark = 7;

/// A fork behind mark 7, or a later one.
struct Fork {
    ForkProgress progress;
    ug_mark_line line{};
    nanoseconds open{0};
    std::uint32_t mark = kMark;

    void launch(int branch, nanoseconds time) {
        progress.launched(branch, time, open += time, mark);
        if (branch >= 0 && branch < ForkProgress::kBranches) progress.mark_is_due(branch, 100us);
    }
    /// A mark on the branch; it executes at once.
    void marked(int branch) {
        line.branch[branch][0] = progress.word(branch);
        progress.marked(branch);
    }
    void next_mark() {
        ++mark;
        open = nanoseconds{0};
    }
    nanoseconds executed(std::uint32_t done = kMark) const { return progress.executed(line, done); }
};

}  // namespace

TEST_CASE("ForkProgress is what its branches' marks tell, and as much as may go without one",
          "[model][fork_progress]") {
    Fork f;
    CHECK_FALSE(f.progress.is_there());
    f.launch(0, 300us);
    f.launch(1, 50us);
    f.launch(2, 400us);
    CHECK(f.progress.is_followed(kMark));
    CHECK(f.executed() == 0us);  // nothing is known to move
    f.marked(0);
    CHECK(f.executed() == 300us + 50us + 100us);
    f.launch(0, 70us);
    CHECK(f.executed() == 370us + 50us + 100us);
    f.marked(2);
    CHECK(f.executed() == 820us);
    CHECK(f.executed(kMark - 1) == 820us);  // what is before is told by other marks
    CHECK(f.executed(kMark + 1) == 0us);    // the mark behind the join tells of all of it
    f.progress.is_over();
    CHECK(f.executed() == 0us);
}

TEST_CASE("ForkProgress tells no more once all marks of its branches have executed",
          "[model][fork_progress]") {
    Fork f;
    f.launch(0, 300us);
    f.launch(1, 300us);
    CHECK_FALSE(f.progress.is_marked(f.line));
    f.progress.marked(0);
    CHECK(f.progress.is_marked(f.line));
    f.line.branch[0][0] = f.progress.word(0);
    CHECK_FALSE(f.progress.is_marked(f.line));
}

TEST_CASE("ForkProgress is followed no more when it stands still while it is paced",
          "[model][fork_progress]") {
    Fork f;
    f.launch(0, 300us);
    f.progress.looked(1ms, 50ms, 3ms);
    f.progress.looked(1ms, 53ms, 3ms);
    CHECK(f.progress.is_followed(kMark));
    f.progress.looked(2ms, 54ms, 3ms);
    f.progress.looked(2ms, 57ms, 3ms);
    CHECK(f.progress.is_followed(kMark));
    f.progress.looked(2ms, 0ms, 3ms);  // another instance
    f.progress.looked(2ms, 3ms, 3ms);
    CHECK(f.progress.is_followed(kMark));
    f.progress.looked(2ms, 4ms, 3ms);
    CHECK_FALSE(f.progress.is_followed(kMark));
}

TEST_CASE("ForkProgress counts what is before the fork once a branch moves",
          "[model][fork_progress]") {
    Fork f;
    f.open = 80us;  // launched behind the mark, on the trunk
    f.launch(0, 200us);
    CHECK(f.executed() == 0us);
    f.marked(0);
    CHECK(f.executed() == 280us);
}

TEST_CASE("ForkProgress asks for a mark when so much is launched on a branch",
          "[model][fork_progress]") {
    Fork f;
    f.launch(0, 60us);
    f.launch(1, 60us);
    CHECK_FALSE(f.progress.mark_is_due(0, 100us));
    f.launch(0, 60us);
    CHECK(f.progress.mark_is_due(0, 100us));
    CHECK_FALSE(f.progress.mark_is_due(1, 100us));
    CHECK(f.progress.word(0) == 120'000);
    f.marked(0);
    CHECK_FALSE(f.progress.mark_is_due(0, 100us));
}

TEST_CASE("ForkProgress counts the fork before as executed, and none before that",
          "[model][fork_progress]") {
    Fork f;
    f.launch(0, 2ms);
    f.marked(0);
    f.next_mark();  // behind its join
    f.launch(1, 3ms);
    CHECK(f.executed(kMark) == 2ms);
    f.marked(1);
    CHECK(f.executed(kMark) == 5ms);
    CHECK(f.executed(kMark + 1) == 3ms);
    f.next_mark();
    f.launch(0, 1ms);
    CHECK(f.executed(kMark) == 0ms);
    CHECK(f.executed(kMark + 1) == 3ms);
    CHECK(f.executed(kMark + 2) == 0ms);
}

TEST_CASE("ForkProgress does not take an older fork's marks for the next one's",
          "[model][fork_progress]") {
    Fork f;
    f.launch(0, 1ms);
    f.launch(1, 1ms);
    f.marked(0);  // branch 1 is done without one
    f.progress.is_over();
    f.next_mark();
    f.launch(1, 500us);
    CHECK(f.executed(f.mark) == 0us);
    f.marked(1);
    CHECK(f.executed(f.mark) == 500us);
}

TEST_CASE("ForkProgress does not follow a fork over more branches than it has",
          "[model][fork_progress]") {
    Fork f;
    f.launch(0, 1ms);
    CHECK(f.progress.is_followed(kMark));
    SECTION("more") {
        f.launch(ForkProgress::kBranches, 1ms);
    }
    SECTION("not known which") {
        f.launch(-1, 1ms);
    }
    SECTION("no marks") {
        f.progress.is_not_marked();
    }
    CHECK_FALSE(f.progress.is_followed(kMark));
    CHECK_FALSE(f.progress.is_followed(kMark + 1));
    f.next_mark();
    f.launch(0, 1ms);
    CHECK(f.progress.is_followed(kMark + 1));
    CHECK(f.executed(kMark) == 0ms);  // the fork before was not followed
}

TEST_CASE("ForkExecuted holds until another mark is seen executed", "[model][fork_progress]") {
    ForkExecuted executed;
    CHECK(executed.load(0) == 0us);
    executed.store(1ms, 0x1234);
    CHECK(executed.load(0x1234) > 1ms - 256ns);
    CHECK(executed.load(0x1234) <= 1ms);
    CHECK(executed.load(0x1235) == 0us);
    executed.forget();
    CHECK(executed.load(0x1234) == 0us);
}
