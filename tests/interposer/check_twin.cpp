// SPDX-License-Identifier: Apache-2.0
#include "tests/interposer/check_twin.h"

#include <array>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "host/base/hash.h"
#include "host/config/resolved_config.h"
#include "tests/interposer/kernels.h"
#include "tests/support/catch.h"

namespace urgengo::testing {
namespace {

using namespace std::chrono_literals;
namespace fs = std::filesystem;

struct SetUp {
    const char* name;
    Environment environment;
    bool says_why = false;  ///< one line a process, at its first launch or hint
    fs::path stats;         ///< written if UrgenGo acts
    bool schedules = false;
    bool pool = false;
};

/// Chains for every thread name that the twins use, tight and loose, and for their hints.
std::vector<config::Chain> chains() {
    std::vector<config::Chain> all{chain("main", 400ms, {{"main", "twin"}})};
    for (int i = 0; i < 8; ++i) {
        const std::string name = "twin_" + std::to_string(i);
        all.push_back(chain(name, 100ms * (8 - i) + 50ms, {{"work", name}}));
    }
    all.push_back(chain("others", 3s, {{"work", "twin*"}}));
    all.push_back(chain("hinted", 500ms, {{"front", ""}, {"back", ""}}));
    return all;
}

/// The main thread's long kernel is known to be long: launches of less urgent tasks are held for as
/// long as they may be.
config::Profile profile() {
    static const auto num_blocks = [] {
        const Outcome about = run_twin({"about_gpu"}, bare());
        INFO("no GPU that the driver can use");  // in tests/interposer/CMakeLists.txt too
        REQUIRE(about.exit_status == 0);
        return std::stoul(about.out);
    }();
    config::TaskProfile main;
    main.name = "main";
    main.kernels = {{"very_long", num_blocks, 1024, 50ms, 1.0}};
    config::Profile result;
    result.chains = {{"main", {main}}};
    return result;
}

/// What is in place of a config that cannot be used.
std::vector<SetUp> broken_set_ups(const fs::path& folder) {
    write_text(folder / "not_json.json", "version: 1\nchains: [}\n");
    write_text(folder / "stale.yaml", "version: 1\n");
    config::Config config;
    config.chains = chains();
    write_text(folder / "stale.resolved.json",
               config::to_resolved_json(config, nullptr, {{"stale.yaml", 0x1234}}));
    Environment bad_mode = configured(preloaded(), write_config(folder / "good.json", "urgengo",
                                                                config::Mode::kEnforce, chains()));
    bad_mode["URGENGO_MODE"] = "faster";
    return {{"no config", preloaded(), true, {}},
            {"config not JSON", configured(preloaded(), folder / "not_json.json"), true, {}},
            {"config missing", configured(preloaded(), folder / "missing.json"), true, {}},
            {"config stale", configured(preloaded(), folder / "stale.yaml"), true, {}},
            {"mode unknown", bad_mode, true, {}}};
}

std::vector<SetUp> working_set_ups(const fs::path& folder) {
    const config::Profile known = profile();
    const auto config = [&](const char* preset, config::Mode mode) {
        return write_config(folder / (std::string(preset) + std::to_string(int(mode)) + ".json"),
                            preset, mode, chains(), &known);
    };
    const auto with = [&](const char* name, const Environment& environment, const fs::path& path,
                          bool schedules, bool pool = false) {
        const fs::path stats = folder / (std::string(name) + " stats.json");
        return SetUp{name, configured(environment, path, stats), false, stats, schedules, pool};
    };
    const auto changed = [&](const char* file, const auto& change) {
        return write_config(folder / file, "urgengo", config::Mode::kEnforce, chains(), &known,
                            change);
    };
    using config::Mode;
    return {with("by stream attribute, stream writes", preloaded(),
                 changed("attribute.json", by_stream_attribute), true),
            with("by stream pool, events, waits sleep", preloaded(),
                 changed("pool.json", by_stream_pool), true, true),
            with("off", preloaded(), config("urgengo", Mode::kOff), false),
            with("observe", preloaded(), config("urgengo", Mode::kObserve), false),
            with("vanilla", preloaded(), config("vanilla", Mode::kEnforce), false),
            with("urgengo", preloaded(), config("urgengo", Mode::kEnforce), true),
            with("gates opened by the host", preloaded(),
                 changed("host.json", dispatched_by(config::Dispatch::kHost)), true),
            with("gates opened by a resident kernel", preloaded(),
                 changed("leased.json", dispatched_by(config::DeviceDispatch::kLeased)), true),
            with("gates opened by arms", preloaded(),
                 changed("armed.json", dispatched_by(config::DeviceDispatch::kArmed)), true),
            with("urgengo by library path, events", by_library_path(),
                 changed("events.json", by_events), true)};
}

/// One of the paper's ways of tracking: another one for another scenario, as each run takes time.
SetUp tracked_set_up(const fs::path& folder, std::string_view scenario) {
    using config::Tracking;
    constexpr std::array kWays{Tracking::kSync, Tracking::kBatched, Tracking::kOverlapped,
                               Tracking::kAsync};
    const Tracking way = kWays[fnv1a64(scenario) % kWays.size()];
    const config::Profile known = profile();
    const fs::path path = write_config(folder / "tracked.json", "urgengo", config::Mode::kEnforce,
                                       chains(), &known, tracked_by(way));
    const fs::path stats = folder / "tracked stats.json";
    return {"another way of tracking", configured(preloaded(), path, stats), false, stats, true};
}

/// The twin did as without UrgenGo.
void check_same(const Outcome& found, const Outcome& alone, int num_lines) {
    CHECK(found.exit_status == alone.exit_status);
    if (found.out != alone.out) {
        const auto a = lines_of(found.out), b = lines_of(alone.out);
        std::size_t i = 0;
        while (i < a.size() && i < b.size() && a[i] == b[i]) ++i;
        FAIL_CHECK("line " << i + 1 << ": '" << (i < a.size() ? a[i] : "(none)") << "', bare: '"
                           << (i < b.size() ? b[i] : "(none)") << "'");
    }
    auto lines = lines_of(found.err);
    INFO("stderr: " << found.err);
    // At the end it may say that some task of the config was never seen. On a real GPU there are
    // others, such as the tests beside this one.
    std::erase_if(lines, [](const std::string& l) {
        return l.rfind("urgengo: warning: ", 0) == 0 ||
               (on_real_gpu() && l.find("another process has the GPU") != std::string::npos);
    });
    CHECK(lines.size() == static_cast<std::size_t>(num_lines));
    for (const std::string& line : lines) CHECK(line.rfind("urgengo: ", 0) == 0);
}

/// UrgenGo was at work: the comparison was not between two bare runs.
void check_statistics(const SetUp& set_up, const Scenario& scenario) {
    INFO(set_up.stats.string());
    const auto stats = nlohmann::json::parse(read_text(set_up.stats), nullptr, false);
    REQUIRE(!stats.is_discarded());
    CHECK(stats.at("tripped") == "");
    int launches = 0, scheduled = 0, holds = 0;
    for (const auto& one : stats.at("chains")) {
        launches += one.at("launches").get<int>();
        scheduled += one.at("scheduled").get<int>();
        holds += one.at("holds").get<int>();
    }
    CHECK(launches > 0);
    CHECK((scheduled > 0) == set_up.schedules);
    if (!set_up.schedules) CHECK(holds == 0);
    if (set_up.schedules && scenario.holds) CHECK(holds > 0);
}

}  // namespace

Environment with(const Environment& more, Environment environment) {
    environment.insert(more.begin(), more.end());
    return environment;
}

void check_twin(const Scenario& scenario, const char* program) {
    const Folder folder;
    const std::vector<std::string> arguments{program, scenario.name};
    const Outcome alone = run(arguments, with(scenario.environment, bare()));
    INFO("scenario " << scenario.name);
    if (on_real_gpu() && alone.exit_status == twin::kNotForThisGpu) {
        WARN("scenario " << scenario.name << " is for the simulated GPU alone");
        return;
    }
    const std::string last = alone.out.empty() ? "(none)" : lines_of(alone.out).back();
    INFO("its last line, bare: " << last);
    REQUIRE(alone.err == "");
    REQUIRE(alone.exit_status == scenario.exit_status);
    REQUIRE(!alone.out.empty());
    for (const auto& set_ups : {broken_set_ups(folder.path()), working_set_ups(folder.path()),
                                std::vector{tracked_set_up(folder.path(), scenario.name)}})
        for (const SetUp& set_up : set_ups) {
            INFO("set-up '" << set_up.name << "'");
            if (scenario.shows_streams && set_up.pool) continue;
            const Outcome found = run(arguments, with(scenario.environment, set_up.environment));
            check_same(found, alone, set_up.says_why ? scenario.starts : 0);
            const bool acts = !set_up.says_why && std::string(set_up.name) != "off";
            if (acts && scenario.reports) check_statistics(set_up, scenario);
        }
}

}  // namespace urgengo::testing
