// SPDX-License-Identifier: Apache-2.0
//
// What marks leave of a task's work, as the whole runtime tells causes from it.
#include "host/runtime/task_pieces.h"

#include "tests/support/common_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

void launch_all(RuntimeFixture& f, ThreadState& thread, CUstream stream) {
    for (int i = 0; i < 20; ++i) f.launch(thread, stream);
}

}  // namespace

TEST_CASE(
    "Of two chains with work on the GPU the one that executed while the frame waited is named",
    "[runtime][causes]") {
    RuntimeFixture f;
    f.resolved.config.scheduler.guard = false;
    f.resolved.config.scheduler.admission = config::Admission::kNone;  // nothing is held
    f.resolved.profile->chains[1].tasks[0] = profile_of("detect", 20, 2ms, 1.0);
    config::Chain third = f.resolved.config.chains[1];
    third.name = "third";
    third.tasks = {{"detect", std::string("th_third")}};
    f.resolved.config.chains.push_back(third);
    f.resolved.profile->chains.push_back({"third", {profile_of("detect", 20, 1ms, 1.0)}});
    for (auto& chain : f.resolved.profile->chains)
        chain.tasks[0].segments = {{1ms, 20, 20, 20, "stream"}};
    ThreadState thread_c;
    const auto stream_c = reinterpret_cast<CUstream>(0xc0);
    const auto execute = [&](std::size_t marks) {
        f.driver.gpu_time_ns = static_cast<std::uint64_t>(f.clock.now().count());
        f.driver.execute_marks(marks);
    };
    f.begin(f.thread_b, "loose");
    f.begin(thread_c, "third");
    launch_all(f, thread_c, stream_c);
    const std::size_t of_third = f.driver.marks.size();
    REQUIRE(of_third > 3);
    f.clock.advance(20ms);  // and it does not execute
    f.begin(f.thread_a, "tight");
    launch_all(f, f.thread_a, kStreamA);
    const std::size_t of_tight = f.driver.marks.size() - of_third;
    for (std::size_t i = 0; i < 20; ++i) {
        f.clock.advance(1ms);
        execute((i + 1) * of_third / 20 - i * of_third / 20);
        f.launch(f.thread_b, kStreamB);  // looks at all tasks, and executes nothing
    }
    const runtime::Wait wait = f.begin_wait(f.thread_a, kStreamA);
    f.clock.advance(2ms);
    execute(of_tight);
    f.rt().waits().after(f.thread_a, wait, true);
    f.rt().frames().task_end(f.thread_a);
    CHECK(f.stats(0).frames.missed == 1);
    CHECK(f.rt().status().chain(0).ring[0].behind.load() == 2);
}

TEST_CASE("However many tasks there are, all of them together have so many marks read",
          "[runtime][causes]") {
    using runtime::TaskPieces;
    for (const std::size_t num : {0u, 1u, 10u})
        CHECK(TaskPieces::share_of(num) == TaskPieces::kAll);

    for (const std::size_t num : {10u, 100u, 256u}) {
        CHECK(TaskPieces::share_of(num) * num <= 10 * TaskPieces::kAll);
        CHECK(TaskPieces::holds_of(TaskPieces::share_of(num)) > 0);
    }
}

TEST_CASE("Marks that are not read leave their work in one piece", "[runtime][causes]") {
    CommonFixture f;
    runtime::TaskState& task = f.tight();
    task.facts.windows.begin(10ms, 100ms, 0ms, 10ms);
    for (std::uint32_t mark = 1; mark <= 100; ++mark) {
        task.log.launched(1ms, {.time = 10ms});
        task.facts.executed.add(mark, {10ms + mark * 2ms, mark * 1ms});
    }
    task.slot->marks_done = 100;
    task.facts.windows.end(100ms, true, 0ms, 210ms);
    const auto pieces_with = [&](std::uint32_t most) {
        std::vector<observe::ExecutedPiece> pieces;
        const runtime::TaskPieces its(task, 10ms, 300ms, most);
        task.facts.windows.for_each([&](const auto& segment) { pieces = its.of(segment); });
        return pieces;
    };
    CHECK(pieces_with(runtime::TaskPieces::kAll).size() == 100);
    const auto pieces = pieces_with(32);
    REQUIRE(pieces.size() == 32);
    CHECK(pieces[0].begin == 10ms);
    CHECK(pieces[0].end == 148ms);
    CHECK(pieces[0].work == 69ms);
    CHECK(observe::took(pieces) == 200ms);
}
