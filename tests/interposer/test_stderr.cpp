// SPDX-License-Identifier: Apache-2.0
//
// What UrgenGo says goes to the stderr that the program was started with, if it can be written to,
// and nowhere else.
#include "tests/interposer/check_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

/// @param name  of a scenario whose stderr is not what the test gave it: nothing arrives there
Scenario scenario(const char* name, int exit_status) {
    Scenario scenario{name, exit_status};
    scenario.starts = 0;
    scenario.environment = {{"URGENGO_SUMMARY", "1"}};
    return scenario;
}

}  // namespace

TEST_CASE("Program goes on as usual when nobody reads its stderr", "[interposer][twins][stderr]") {
    check_twin(scenario("stderr_dead", 9));
}

TEST_CASE("Program does not wait when its stderr takes no more", "[interposer][twins][stderr]") {
    check_twin(scenario("stderr_full", 9));
}

TEST_CASE("File of the program's is its own when it has the number of stderr",
          "[interposer][twins][stderr]") {
    check_twin(scenario("stderr_reused", 0));
    check_twin(scenario("stderr_closed", 0));
}

TEST_CASE("Lines and the summary arrive when stderr is a pipe that is read",
          "[interposer][stderr]") {
    const Folder folder;
    const std::string program = placed(TWIN_PATH) + " copies 2>&1 >/dev/null | cat";
    CHECK(run({"/bin/sh", "-c", program}, preloaded()).out ==
          "urgengo: URGENGO_CONFIG is not set: the program runs as if UrgenGo were not there\n");
    Environment environment = configured(
        preloaded(),
        write_config(folder.path() / "config.json", "urgengo", config::Mode::kObserve,
                     {chain("main", std::chrono::seconds(10), {{"the main task", "twin"}})}));
    environment["URGENGO_SUMMARY"] = "1";
    const Outcome direct = run_twin({"copies"}, environment);
    CHECK(lines_of(direct.err).size() > 1);
    CHECK(lines_of(run({"/bin/sh", "-c", program}, environment).out).size() ==
          lines_of(direct.err).size());
}
