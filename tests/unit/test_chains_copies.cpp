// SPDX-License-Identifier: Apache-2.0
//
// Copies of a chain: their names, their tasks, and that they are late no more than asked for.
#include <fnmatch.h>

#include <stdexcept>

#include "tests/support/catch.h"
#include "tools/chains/copies.h"
#include "tools/chains/scenario.h"

using namespace urgengo::chains;

namespace {

Task task(const std::string& name, double cpu_ms, int grid, int max_inputs = 1) {
    return {name, cpu_ms, 2 * cpu_ms, 1, max_inputs, {Kernel{KernelKind::kCompute, grid}}};
}

Workload sample() {
    Workload workload;
    workload.chains = {{"C0", 150, 120, {task("detect3d", 1, 10, 2)}},
                       {"C3", 200, 120, {task("detect2d", 2, 30), task("sign", 3, 40)}},
                       {"C9", 500, 120, {task("calibrate", 4, 50)}}};
    for (std::size_t i = 0; i < workload.chains.size(); i++) workload.chains[i].place = i;
    return workload;
}

std::vector<std::string> names(const Workload& workload) {
    std::vector<std::string> list;
    for (const Chain& chain : workload.chains) list.push_back(chain.name);
    return list;
}

}  // namespace

TEST_CASE("keep_only leaves the chains that are named", "[unit][chains]") {
    Workload workload = sample();
    keep_only(workload, {"C9", "C0"});
    CHECK(names(workload) == std::vector<std::string>{"C9", "C0"});
    CHECK(workload.chains[0].place == 2);
    CHECK(workload.chains[1].place == 0);
    CHECK_THROWS_WITH(keep_only(workload, {"C3"}), "--only: found \"C3\", accepted: C9, C0");
}

TEST_CASE("make_copies gives names that no other copy's pattern matches", "[unit][chains]") {
    Workload workload = sample();
    make_copies(workload, 40);
    REQUIRE(workload.chains.size() == 3 * 40);
    CHECK(workload.chains.front().name == "x01C0");
    CHECK(workload.chains.back().name == "x40C9");
    CHECK(workload.chains.back().copy_of == "C9");
    CHECK(workload.chains.back().place == 3 * 40 - 1);
    for (const Chain& chain : workload.chains) {
        int matched = 0;
        for (const Chain& other : workload.chains) {
            matched += fnmatch((chain.name + "*").c_str(), other.name.c_str(), 0) == 0;
        }
        CHECK(matched == 1);
        CHECK(fnmatch((chain.copy_of + "*").c_str(), chain.name.c_str(), 0) != 0);
        CHECK(thread_name(Threads::kPerTask, chain, chain.tasks[0]).size() <= 15);
    }
}

TEST_CASE("make_copies refuses names that are too long for a thread", "[unit][chains]") {
    Workload workload = sample();
    workload.chains[0].tasks[0].name = "calibration";
    CHECK_THROWS_WITH(make_copies(workload, 1),
                      "--copies: found the thread name \"x01C0.calibration\", accepted: at most "
                      "15 bytes");
}

TEST_CASE("merge_tasks keeps the kernels in order and all CPU time", "[unit][chains]") {
    Workload workload = sample();
    keep_only(workload, {"C3"});
    merge_tasks(workload);
    REQUIRE(workload.chains[0].tasks.size() == 1);
    const Task& merged = workload.chains[0].tasks[0];
    CHECK(merged.name == "detect2d");
    CHECK(merged.cpu_ms == 5);
    CHECK(merged.isolated_ms == 10);
    REQUIRE(merged.kernels.size() == 2);
    CHECK(merged.kernels[0].grid == 30);
    CHECK(merged.kernels[1].grid == 40);
}

TEST_CASE("merge_tasks refuses a chain whose inputs differ in size", "[unit][chains]") {
    Workload workload = sample();
    CHECK_THROWS_AS(merge_tasks(workload), std::runtime_error);
}
