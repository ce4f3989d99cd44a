// SPDX-License-Identifier: Apache-2.0
//
// What marks leave of a task's work, as the whole runtime tells causes from it.
#include "host/runtime/task_pieces.h"

#include "tests/support/runtime_fixture.h"

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
