// SPDX-License-Identifier: Apache-2.0
//
// UrgenGo as the program's NVTX tool: NVTX finds it, and the program cannot tell. What the tool
// understands: tests/unit/test_nvtx.cpp.
#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

Environment with_tool(Environment environment) {
    environment["NVTX_INJECTION64_PATH"] = INTERPOSER_FOLDER "/libcuda.so.1";
    return environment;
}

}  // namespace

TEST_CASE("Program with NVTX ranges runs as it does bare when UrgenGo is its tool",
          "[interposer][nvtx]") {
    const Folder folder;
    const auto config =
        write_config(folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
                     {chain("main", std::chrono::milliseconds(100), {{"main", "twin"}})});
    const Outcome expected = run_twin({"nvtx"}, bare());
    CHECK(expected.exit_status == 0);
    CHECK(lines_of(expected.out).size() == 82);
    for (const Environment& environment : {preloaded(), by_library_path(), bare()}) {
        const Outcome found = run_twin({"nvtx"}, configured(with_tool(environment), config));
        CHECK(found.exit_status == expected.exit_status);
        CHECK(found.out == expected.out);
        CHECK(found.err == expected.err);
    }
}

TEST_CASE("NVTX has a tool when, and only when, UrgenGo is named as one", "[interposer][nvtx]") {
    const auto first_line = [](const Environment& environment) {
        return lines_of(run_twin({"nvtx", "ask"}, environment).out).at(0);
    };
    CHECK(first_line(bare()) == "a tool: 0");
    CHECK(first_line(preloaded()) == "a tool: 0");
    CHECK(first_line(with_tool(preloaded())) == "a tool: 1");
    CHECK(first_line(with_tool(by_library_path())) == "a tool: 1");
}

TEST_CASE("Children name strings as usual when they are forked while another thread does",
          "[interposer][nvtx][fork]") {
    const Outcome expected = run_twin({"fork_naming"}, bare());
    const Outcome found = run_twin({"fork_naming"}, with_tool(preloaded()));
    CHECK(found.exit_status == 0);
    CHECK(found.out == expected.out);
    CHECK(found.err == "");
}

TEST_CASE("Names are kept up to a number, and one line says so, when a program has no end of them",
          "[interposer][nvtx]") {
    const Outcome bare_run = run_twin({"nvtx_many"}, bare());
    CHECK(bare_run.out == "kept 0, the first again 1\nrange: -2 -2\n");
    const Outcome found = run_twin({"nvtx_many"}, with_tool(preloaded()));
    CHECK(found.exit_status == 0);
    CHECK(found.out == "kept 65536, the first again 1\nrange: -2 -2\n");
    CHECK(found.err ==
          "urgengo: NVTX: the program names more than 65536 strings or domains; those after them "
          "have no name here\n");
}
