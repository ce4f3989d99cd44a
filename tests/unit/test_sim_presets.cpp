// SPDX-License-Identifier: Apache-2.0
//
// A table of misses of all presets in virtual time, against stored bounds: whoever makes a decision
// worse sees here for whom. A change that is meant is stored anew, and its commit says so:
//
//   URGENGO_UPDATE_GOLDEN=1 build/release/bin/urgengo_sim_preset_tests
//
// The same as a table: urgengo sim --rows all --f-a 0.9,1.1 --seeds 4,5 --seconds 15
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include <fmt/format.h>

#include "host/config/presets.h"
#include "tests/support/catch.h"
#include "tools/chains/spec.h"
#include "tools/sim/governed_subject.h"
#include "tools/sim/profiled.h"
#include "tools/sim/workloads.h"
#include "tools/sim/world.h"

using namespace urgengo;
using namespace urgengo::sim;
namespace config = urgengo::config;

namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kPath = SIM_MISSES;
constexpr double kSeconds = 15;
constexpr double kLoads[] = {0.9, 1.1};
constexpr std::uint32_t kSeeds[] = {4, 5};

/// Misses may differ by so much from the stored ones, in points: another order of events that
/// nobody decides about makes a few frames late, or none.
double margin(double stored_pct) {
    return 0.4 + stored_pct / 10;
}

/// @returns in %, the mean over the seeds
double misses(const chains::Workload& workload, const config::Scheduler& scheduler, double f_a) {
    WorldSettings settings;
    settings.seconds = kSeconds;
    settings.scenario.f_a = f_a;
    settings.scenario.tight = chains::tight_chains(0.4);
    double sum = 0;
    for (const std::uint32_t seed : kSeeds) {
        settings.seed = seed;
        GovernedSubject subject(configured(workload, settings.scenario, scheduler),
                                profiled(workload));
        sum += 100 * World(workload, subject, settings).run().overall_miss_ratio();
    }
    return sum / double(std::size(kSeeds));
}

}  // namespace

TEST_CASE("No preset misses more than what is stored", "[unit][sim]") {
    Json stored;
    if (std::ifstream file(kPath); file) stored = Json::parse(file);
    // NOLINTNEXTLINE(concurrency-mt-unsafe)
    const bool updates = std::getenv("URGENGO_UPDATE_GOLDEN") != nullptr;
    const chains::Workload workload = h200_ten_chains();
    const auto check = [&](const std::string& name, const config::Scheduler& scheduler) {
        for (const double f_a : kLoads) {
            const std::string load = fmt::format("f_a {}", f_a);
            const double found = misses(workload, scheduler, f_a);
            if (updates) stored[name][load] = std::round(100 * found) / 100;
            INFO(name << ", " << load);
            REQUIRE(stored.contains(name));
            const double expected = stored[name].value(load, -1.0);
            CHECK(found <= expected + margin(expected));
            // The others are there to be compared with: better ones would be others.
            if (scheduler.preset != "urgengo") CHECK(found >= expected - margin(expected));
        }
    };
    for (const std::string& name : config::list_presets()) check(name, *config::preset(name));
    config::Scheduler alone = *config::preset("urgengo");
    alone.guard = false;
    check("urgengo without its guard", alone);
    if (updates) std::ofstream(kPath) << stored.dump(1) << '\n';
}
