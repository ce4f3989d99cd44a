// SPDX-License-Identifier: Apache-2.0
//
// Variables with values that are not accepted: the program runs as it would, and one line says so.
#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;

namespace {

Environment scheduled(const Folder& folder, const std::filesystem::path& stats = {}) {
    return configured(preloaded(),
                      write_config(folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
                                   {chain("main", 10s, {{"m", "twin"}})}),
                      stats);
}

}  // namespace

TEST_CASE("Program ends as usual and one line says why when its statistics cannot be written",
          "[interposer][settings]") {
    const Folder folder;
    const std::string expected = run_twin({"copies"}, bare()).out;
    for (const std::string stats : {"/nonexistent/stats.json", "/dev/null/stats.json"}) {
        const Outcome outcome = run_twin({"copies"}, scheduled(folder, stats));
        CHECK(outcome.exit_status == 0);
        CHECK(outcome.out == expected);
        const auto lines = lines_of(outcome.err);
        REQUIRE(lines.size() == 1);
        CHECK(lines[0].rfind("urgengo: URGENGO_STATS: " + stats +
                                 ": cannot create a temporary file beside it: ",
                             0) == 0);
    }
}

TEST_CASE("Summary is not printed and one line says why when its variable is neither 0 nor 1",
          "[interposer][settings]") {
    const Folder folder;
    Environment environment = scheduled(folder);
    environment["URGENGO_SUMMARY"] = "yes";
    CHECK(run_twin({"copies"}, environment).err ==
          "urgengo: URGENGO_SUMMARY: found 'yes', accepted: 0, 1\n");
    environment["URGENGO_SUMMARY"] = "0";
    CHECK(run_twin({"copies"}, environment).err == "");
}
