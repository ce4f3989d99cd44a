// SPDX-License-Identifier: Apache-2.0
//
// Marks that an NVTX tool gets of what goes wrong, and of what UrgenGo does, in virtual time.
// What else it gets: tests/interposer/test_nvtx_out.cpp.
#include "host/observe/nvtx_out.h"

#include "tests/support/nvtx_tool.h"
#include "tests/support/steering_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using observe::nvtx::Category;

namespace {

struct Watched : SteeringFixture {
    const NvtxTool tool;

    /// From here on the tool is told. The config is as the test wants it.
    void watch() {
        rt().show_in_nvtx(NvtxTool::link());
        REQUIRE(rt().observers().nvtx.is_on());
    }
    /// @param took  from its arrival to its end
    void frame(const char* chain, std::chrono::nanoseconds took) {
        const auto token = rt().frames().arrival(nullptr, chain, clock.now());
        REQUIRE_FALSE(rt().frames().task_begin(thread_a, token, "detect"));
        clock.advance(took);
        rt().frames().task_end(thread_a);
    }
};

using Marks = std::vector<std::string>;

Marks of_chains(const char* name) {
    return NvtxTool::marks(Category::kChain, name);
}
Marks of_urgengo(const char* name) {
    return NvtxTool::marks(Category::kDispatch, name);
}

bool has(const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
}

}  // namespace

TEST_CASE("NVTX tool gets a mark of each frame that is late, with its cause", "[observe][nvtx]") {
    Watched f;
    f.watch();
    f.frame("tight", 20ms);
    CHECK(of_chains("miss").empty());
    f.frame("tight", 20ms + 1ns);
    f.frame("loose", 90ms);
    const auto marks = of_chains("miss");
    REQUIRE(marks.size() == 1);
    INFO(marks[0]);
    CHECK(has(marks[0], "chain tight, task -, instance 2, "));
    CHECK(has(marks[0], "laxity_end_ns -1, outcome late, reason "));
    CHECK_FALSE(has(marks[0], "reason -"));
    CHECK(of_chains("early exit").empty());
    CHECK(of_chains("dropped").empty());
}

TEST_CASE("NVTX tool gets a mark of a frame that its program is told to end", "[observe][nvtx]") {
    Watched f;
    f.resolved.config.chains[0].on_late = config::OnLate::kExit;
    f.watch();
    const auto token = f.rt().frames().arrival(nullptr, "tight", f.clock.now() - 19ms);
    REQUIRE(f.rt().frames().task_begin(f.thread_a, token, "detect"));
    f.rt().frames().task_end(f.thread_a);
    const auto marks = of_chains("early exit");
    REQUIRE(marks.size() == 1);
    INFO(marks[0]);
    CHECK(has(marks[0], "chain tight, "));
    CHECK(has(marks[0], "outcome exited, reason ended_early"));
    CHECK(of_chains("miss").empty());  // it is one or the other
}

TEST_CASE("NVTX tool gets a mark of each frame that never comes to its end", "[observe][nvtx]") {
    Watched f;
    f.watch();
    f.frame("tight", 1ms);
    f.rt().frames().arrival(nullptr, "tight", f.clock.now());
    f.clock.advance(50ms);
    f.frame("loose", 1ms);
    f.frame("tight", 1ms);
    REQUIRE(f.stats(0).frames.missed == 1);
    const auto marks = of_chains("dropped");
    REQUIRE(marks.size() == 1);
    INFO(marks[0]);
    CHECK(has(marks[0], "chain tight, task -, "));
    CHECK(has(marks[0], "outcome dropped, reason dropped"));
}

TEST_CASE("NVTX tool gets a mark of each mode that UrgenGo is switched to", "[observe][nvtx]") {
    Watched f;
    f.watch();
    f.begin_both();
    f.steer(abi::ControlCommand::kObserve);
    f.steer(abi::ControlCommand::kOff);
    f.steer(abi::ControlCommand::kOn);
    CHECK(of_urgengo("mode") == Marks{"mode observe", "mode off", "mode enforce"});
    CHECK(of_urgengo("trip").empty());
}

TEST_CASE("NVTX tool gets a mark when UrgenGo switches itself off", "[observe][nvtx]") {
    Watched f;
    f.watch();
    f.begin_both();
    f.rt().trip();
    CHECK(of_urgengo("trip") == Marks{"mode off"});
    f.steer(abi::ControlCommand::kOn);  // refused
    CHECK(of_urgengo("trip").size() == 1);
}
