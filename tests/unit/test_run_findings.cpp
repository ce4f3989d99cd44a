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

TEST_CASE("Check says when a run warned of nothing", "[unit][cli]") {
    const Folder folder;
    const auto text_of = [&](const std::string& json) {
        const auto found = read_run_findings(folder.write("s.json", json));
        REQUIRE(found);
        return format_run_findings(*found);
    };
    const auto says = [](const std::string& text, const char* what) {
        return text.find(what) != std::string::npos;
    };
    CHECK(says(text_of(observe::to_json({}, "enforce", "")), "It warned of nothing.\n"));
    CHECK_FALSE(says(text_of(observe::to_json({}, "off", "")), "It warned of nothing"));
    const std::string tripped = text_of(observe::to_json({}, "tripped", "a reason"));
    CHECK(says(tripped, "UrgenGo stopped scheduling: a reason\n"));
    CHECK_FALSE(says(tripped, "It warned of nothing"));
    CHECK(says(text_of(R"({"mode": "enforce", "tripped": "", "guard": "", "chains": []})"),
               "The version that ran wrote no warnings into its statistics.\n"));
}

TEST_CASE("Check refuses what are no statistics", "[unit][cli]") {
    const Folder folder;
    const std::string file = folder.write("s.json", "{\"mode\": 3}");
    CHECK(read_run_findings(file).error().find(file + ": $.mode: found ") == 0);
    CHECK_FALSE(read_run_findings(folder.path("none.json")));
}

}  // namespace
}  // namespace urgengo::cli
