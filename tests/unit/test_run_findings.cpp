// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/run_findings.h"

#include "host/observe/statistics.h"
#include "tests/support/catch.h"
#include "tests/support/folder.h"

namespace urgengo::cli {
namespace {

using testing::Folder;

TEST_CASE("Check tells what a run's statistics say of config and profile", "[unit][cli]") {
    const Folder folder;
    observe::ChainStatistics lidar;
    lidar.name = "lidar";
    lidar.guard = "priorities";
    lidar.frames.instances = 40, lidar.frames.late_starts = 12, lidar.frames.early = 2;
    lidar.tasks.unknown = 9;
    const std::string file =
        folder.write("s.json", observe::to_json({&lidar}, "enforce", "", "guard: fell back", {}, {},
                                                {"warning: GPU times were corrected"}));
    const auto found = read_run_findings(file);
    REQUIRE(found);
    const std::string text = format_run_findings(*found);
    INFO(text);
    CHECK(text.find("In the run of " + file + ", mode enforce:\n") == 0);
    CHECK(text.find("guard: fell back\nwarning: GPU times were corrected\n") != std::string::npos);
    const auto json = run_findings_json(*found);
    CHECK(json["chains"][0] == nlohmann::ordered_json({{"chain", "lidar"},
                                                       {"guard", "priorities"},
                                                       {"frames", 40},
                                                       {"late_starts", 12},
                                                       {"early_frames", 2},
                                                       {"unknown_launches", 9}}));
    CHECK(json["warnings"].size() == 1);
}

TEST_CASE("Check says when a run was as config and profile say", "[unit][cli]") {
    const Folder folder;
    const auto found =
        read_run_findings(folder.write("s.json", observe::to_json({}, "tripped", "a reason")));
    REQUIRE(found);
    const std::string text = format_run_findings(*found);
    CHECK(text.find("UrgenGo stopped scheduling: a reason\n") != std::string::npos);
    CHECK(text.find("Nothing was other than config and profile say.\n") != std::string::npos);
}

TEST_CASE("Check refuses what are no statistics", "[unit][cli]") {
    const Folder folder;
    const std::string file = folder.write("s.json", "{\"mode\": 3}");
    CHECK(read_run_findings(file).error().find(file + ": $.mode: found ") == 0);
    CHECK_FALSE(read_run_findings(folder.path("none.json")));
}

}  // namespace
}  // namespace urgengo::cli
