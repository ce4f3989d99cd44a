// SPDX-License-Identifier: Apache-2.0
//
// A chain whose profile says four times what it takes would be given up every frame, since by that
// it cannot be met; bare it is in time.
#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
using nlohmann::json;

namespace {

struct Counts {
    long frames = 0, late = 0, late_in_last_third = 0;
};

struct GuardedRun {
    Counts tight, loose;
    json statistics;
    std::string err;
};

GuardedRun run_periods(const std::string& seconds, const Environment& environment) {
    GuardedRun run;
    const Outcome outcome = run_twin({"periods", seconds}, environment);
    REQUIRE(outcome.exit_status == 0);
    run.err = outcome.err;
    std::istringstream lines(outcome.out);
    std::string name;
    for (Counts* c : {&run.tight, &run.loose})
        lines >> name >> c->frames >> c->late >> c->late_in_last_third;
    UNSCOPED_INFO(outcome.out);
    return run;
}

GuardedRun run_misled(const std::string& seconds, bool guard) {
    const Folder folder;
    const auto stats = folder.path() / "stats.json";
    config::Chain tight = chain("tight", 24ms, {{"work", "tight"}}),
                  loose = chain("loose", 50ms, {{"work", "loose"}});
    tight.period = 40ms;
    config::Profile profile;
    profile.chains = {{"tight", {periods_profile(16, 2ms)}},
                      {"loose", {periods_profile(60, 500us)}}};
    const auto config = write_config(folder.path() / "config.json", "urgengo",
                                     config::Mode::kEnforce, {tight, loose}, &profile,
                                     [guard](config::Config& its) { its.scheduler.guard = guard; });
    GuardedRun run = run_periods(seconds, configured(preloaded(), config, stats));
    run.statistics = json::parse(read_text(stats), nullptr, false);
    REQUIRE(!run.statistics.is_discarded());
    return run;
}

}  // namespace

// With the guard or without: estimates correct themselves before it has anything to compare.
// (Before they did, 36 to 74 of 75 frames were late.)
TEST_CASE("A chain whose profile is four times too long is in time after a few frames",
          "[interposer][guard][slow]") {
    const GuardedRun bare_run = run_periods("3", bare());
    CHECK(bare_run.tight.late <= bare_run.tight.frames / 10);
    for (const bool guard : {false, true}) {
        const GuardedRun misled = run_misled("6", guard);
        INFO("guard " << guard << ", late " << misled.tight.late << " of " << misled.tight.frames);
        CHECK(misled.tight.late <= misled.tight.frames / 10);
        CHECK(misled.tight.late_in_last_third <= 2 + misled.tight.frames / 30);
        CHECK(misled.statistics.at("chains").at(0).at("guard") == (guard ? "enforce" : "off"));
        CHECK(misled.err.find("GPU times of task 'work' of chain 'tight' were 0.") !=
              std::string::npos);
    }
}
