// SPDX-License-Identifier: Apache-2.0
//
// The whole runtime in virtual time, every launch of it: whoever moves or changes a decision sees
// here whether any launch goes elsewhere, at another time or at another priority. What is expected
// is stored. A change that is meant is stored anew, and its commit says so:
//
//   URGENGO_UPDATE_GOLDEN=1 build/release/bin/urgengo_lockstep_tests
//
// Where the first difference is: URGENGO_LOCKSTEP_LOG=FOLDER writes all launches of each scenario
// there; compare with those of the version before.
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include <fmt/format.h>

#include "host/config/presets.h"
#include "tests/support/catch.h"
#include "tests/support/lockstep_chains.h"

using namespace urgengo::testing;
namespace config = urgengo::config;

namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kPath = LOCKSTEP_GOLDEN;

LockstepScenario scenario_of(const std::string& preset, double f_a) {
    LockstepScenario scenario;
    scenario.name = fmt::format("{} {}", preset, f_a);
    scenario.scheduler = *config::preset(preset);
    scenario.f_a = f_a;
    return scenario;
}

std::vector<LockstepScenario> scenarios() {
    std::vector<LockstepScenario> all;
    for (const char* preset : {"urgengo", "edf", "paper", "paam", "dcuda", "vanilla"})
        for (const double f_a : {0.9, 1.3}) all.push_back(scenario_of(preset, f_a));
    const auto add = [&](const char* what) -> LockstepScenario& {
        all.push_back(scenario_of("urgengo", 1.1));
        all.back().name += fmt::format(" {}", what);
        return all.back();
    };
    add("forked").forks = true;
    add("locks").locks = true;
    add("bystander").bystander = true;
    add("launch bound").launch_bound = true;
    add("much time").f_d = 20;
    add("no profile").has_profile = false;
    add("learn").scheduler.progress.learn = true;
    add("overlapped").scheduler.progress.tracking = config::Tracking::kOverlapped;
    return all;
}

std::string text_of(const LockstepOutcome& o) {
    return fmt::format("{} launches, {} marks, {} frames, {} missed, {} us held, hash {:016x}",
                       o.launches, o.marks, o.frames, o.missed, o.held_us, o.hash);
}

const char* variable(const char* name) {
    return std::getenv(name);  // NOLINT(concurrency-mt-unsafe)
}

}  // namespace

TEST_CASE("A run in lockstep repeats, launch by launch", "[unit][lockstep]") {
    LockstepScenario scenario = scenario_of("urgengo", 1.3);
    scenario.duration = std::chrono::milliseconds(500);
    CHECK(run_lockstep(scenario) == run_lockstep(scenario));
}

TEST_CASE("Every launch is the stored one", "[unit][lockstep]") {
    Json golden;
    if (std::ifstream file(kPath); file) golden = Json::parse(file);
    const bool updates = variable("URGENGO_UPDATE_GOLDEN") != nullptr;
    const char* const logs = variable("URGENGO_LOCKSTEP_LOG");
    for (LockstepScenario& scenario : scenarios()) {
        if (logs) scenario.log_path = fmt::format("{}/{}.log", logs, scenario.name);
        const std::string found = text_of(run_lockstep(scenario));
        if (updates) golden[scenario.name] = found;
        INFO(scenario.name);
        CHECK(found == golden.value(scenario.name, ""));
    }
    if (updates) std::ofstream(kPath) << golden.dump(1) << '\n';
}
