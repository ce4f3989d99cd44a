// SPDX-License-Identifier: Apache-2.0
//
// Twins on the driver of CUDA 12.0 (525), which lacks what later ones have: nothing of that is
// needed for scheduling. Left out are the scenarios that themselves call something newer.
#include <nlohmann/json.hpp>

#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;

namespace {

Environment on_driver_12_0(Environment environment) {
    environment["LD_LIBRARY_PATH"] = SIMGPU_12_0_FOLDER;
    environment["TWIN_SIMGPU"] = SIMGPU_12_0_FOLDER "/libcuda.so.1";
    environment["URGENGO_REAL_LIBCUDA"] = SIMGPU_12_0_FOLDER "/libcuda.so.1";
    return environment;
}

}  // namespace

TEST_CASE("Programs do the same when the driver is of CUDA 12.0", "[interposer][twins]") {
    if (on_real_gpu()) return;
    struct Scenario {
        const char* name;
        int exit_status = 0;
    };
    for (const Scenario& scenario : {Scenario{"attributes"},
                                     {"calls_at_exit"},
                                     {"copies"},
                                     {"current_context"},
                                     {"dlopen"},
                                     {"errors"},
                                     {"exit_busy", 5},
                                     {"exit_pending", 3},
                                     {"graph_streams"},
                                     {"graph_updates"},
                                     {"hints"},
                                     {"modules"},
                                     {"order"},
                                     {"per_thread"},
                                     {"priorities"},
                                     {"recreated_contexts"},
                                     {"renamed_threads"},
                                     {"short_threads"},
                                     {"streams"},
                                     {"threads"},
                                     {"two_contexts"}}) {
        INFO(scenario.name);
        const Folder folder;
        const auto stats = folder.path() / "stats.json";
        const auto config = write_config(
            folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
            {chain("main", 400ms, {{"m", "twin"}}), chain("others", 3s, {{"o", "twin*"}})});
        const Outcome alone = run_twin({scenario.name}, on_driver_12_0(bare()));
        REQUIRE(alone.exit_status == scenario.exit_status);
        REQUIRE(!alone.out.empty());
        const Outcome found =
            run_twin({scenario.name}, configured(on_driver_12_0(preloaded()), config, stats));
        INFO(found.err);
        CHECK(found.exit_status == alone.exit_status);
        CHECK(found.out == alone.out);
        const auto report = nlohmann::json::parse(read_text(stats), nullptr, false);
        REQUIRE(!report.is_discarded());
        CHECK(report.at("tripped") == "");
        int scheduled = 0;
        for (const auto& one : report.at("chains")) scheduled += one.at("scheduled").get<int>();
        CHECK(scheduled > 0);
    }
}
