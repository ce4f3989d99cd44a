// SPDX-License-Identifier: Apache-2.0
//
// Positive twins: whatever UrgenGo is set up to do, a program's output and end are what they are
// without it, and UrgenGo says nothing but the one line that says why it does nothing.
#include <array>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "host/base/hash.h"
#include "host/config/resolved_config.h"
#include "tests/interposer/kernels.h"
#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
namespace fs = std::filesystem;

namespace {

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

struct Scenario {
    const char* name;
    int exit_status = 0;
    int starts = 1;                ///< processes that launch or hint, and so start UrgenGo
    bool reports = true;           ///< ends so that statistics are written, of launches
    bool holds = false;            ///< some launches are certain to be held when UrgenGo schedules
    Environment environment = {};  ///< in every run
    bool shows_streams = false;    ///< prints which stream a kernel ran on, which a pool changes
};

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
    // At the end it may say that some task of the config was never seen.
    std::erase_if(lines,
                  [](const std::string& l) { return l.rfind("urgengo: warning: ", 0) == 0; });
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

Environment with(const Environment& more, Environment environment) {
    environment.insert(more.begin(), more.end());
    return environment;
}

void check_twin(const Scenario& scenario, const char* program = TWIN_PATH) {
    const Folder folder;
    const std::vector<std::string> arguments{program, scenario.name};
    const Outcome alone = run(arguments, with(scenario.environment, bare()));
    INFO("scenario " << scenario.name);
    if (on_real_gpu() && alone.exit_status == twin::kNotForThisGpu) {
        WARN("scenario " << scenario.name << " is for the simulated GPU alone");
        return;
    }
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

}  // namespace

TEST_CASE("Copies and memsets give the same data when UrgenGo is loaded", "[interposer][twins]") {
    check_twin({"copies"});
}

TEST_CASE("Copies and memsets of every shape keep their place when launches around them are held",
          "[interposer][twins]") {
    check_twin({"linear_copies"});
    check_twin({"shaped_copies"});
    check_twin({"array_copies"});
    check_twin({"batch_copies"});
}

TEST_CASE("Every kind of stream gives the same data when UrgenGo is loaded",
          "[interposer][twins]") {
    check_twin({"streams"});
}

TEST_CASE("Per-thread entry points give the same data when UrgenGo is loaded",
          "[interposer][twins]") {
    Scenario scenario{"per_thread"};
    scenario.shows_streams = true;
    check_twin(scenario);
}

TEST_CASE("Modules work the same when they are unloaded and loaded again", "[interposer][twins]") {
    check_twin({"modules"});
}

TEST_CASE("Refused calls have the same results when UrgenGo is loaded", "[interposer][twins]") {
    check_twin({"errors"});
}

TEST_CASE("Calls have the same results when the driver is not initialised", "[interposer][twins]") {
    check_twin({"too_early"});
}

TEST_CASE("Launch attributes have the same effect when UrgenGo adds its own",
          "[interposer][twins]") {
    check_twin({"attributes"});
}

TEST_CASE("Order and attributes are the same when marks overlap what is before them",
          "[interposer][twins]") {
    if (on_real_gpu()) return;  // it is what it is
    for (const char* name : {"order", "attributes"}) {
        Scenario scenario{name};
        scenario.environment = {{"SIMGPU_DEVICE", "h200"}};
        check_twin(scenario);
    }
}

TEST_CASE("Streams have their own priority when their launches were scheduled",
          "[interposer][twins]") {
    check_twin({"priorities"});
}

TEST_CASE("Order on and between streams is the same when UrgenGo is loaded",
          "[interposer][twins]") {
    check_twin({"order"});
}

TEST_CASE("Old launches, values, pools, managed memory and events keep their order",
          "[interposer][twins]") {
    check_twin({"order_rest"});
}

TEST_CASE("Current context is the program's own when UrgenGo works in it", "[interposer][twins]") {
    check_twin({"current_context"});
}

TEST_CASE("Several contexts work the same when UrgenGo is loaded", "[interposer][twins]") {
    check_twin({"two_contexts"});
}

TEST_CASE("Contexts work the same when they are destroyed and made again", "[interposer][twins]") {
    check_twin({"recreated_contexts"});
}

TEST_CASE("Second device is left alone when the first one's work is scheduled",
          "[interposer][twins]") {
    Scenario scenario{"devices"};
    scenario.environment = {{"SIMGPU_DEVICES", "2"}};
    scenario.holds = true;
    check_twin(scenario);
}

TEST_CASE("Captures see the program's own work only when other threads launch",
          "[interposer][twins][graphs]") {
    check_twin({"capture_busy"});
}

TEST_CASE("Captures stay valid when UrgenGo starts, or enters a context, meanwhile",
          "[interposer][twins][graphs]") {
    check_twin({"capture_first_launch"});
}

TEST_CASE("Default streams capture and are refused as usual when UrgenGo is loaded",
          "[interposer][twins][graphs]") {
    check_twin({"capture_implicit"});
}

TEST_CASE("Captures over several streams are the same when UrgenGo is loaded",
          "[interposer][twins][graphs]") {
    check_twin({"capture_joined"});
}

TEST_CASE("Graphs run the same when they are updated and cloned", "[interposer][twins][graphs]") {
    check_twin({"graph_updates"});
}

TEST_CASE("Graphs run the same when they have children, memory and conditions",
          "[interposer][twins][graphs]") {
    check_twin({"graph_nodes"});
}

TEST_CASE("Graphs run the same when they are launched on every kind of stream",
          "[interposer][twins][graphs]") {
    check_twin({"graph_streams"});
}

TEST_CASE("Graph runs the same when its launch is held", "[interposer][twins][graphs]") {
    Scenario scenario{"graph_held"};
    scenario.holds = true;
    check_twin(scenario);
}

TEST_CASE("Nodes keep their own priorities when their streams were scheduled",
          "[interposer][twins][graphs]") {
    check_twin({"graph_node_priorities"});
}

TEST_CASE("Many threads give the same results when their launches are scheduled",
          "[interposer][twins]") {
    check_twin({"threads"});
}

TEST_CASE("Threads give the same results when they change their names", "[interposer][twins]") {
    check_twin({"renamed_threads"});
}

TEST_CASE("Threads give the same results when they end with work under way",
          "[interposer][twins]") {
    check_twin({"short_threads"});
}

// The sanitizers themselves abort when a cancelled thread unwinds, bare too.
#if !SANITIZED
TEST_CASE("Thread is cancelled as usual when it waits in a call", "[interposer][twins]") {
    check_twin({"cancel_waiting"});
}

TEST_CASE("Thread is cancelled as usual when its launch is held", "[interposer][twins]") {
    Scenario scenario{"cancel_held"};
    scenario.holds = true;
    check_twin(scenario);
}
#endif

TEST_CASE("Program is left alone when it never calls CUDA", "[interposer][twins]") {
    Scenario scenario{"no_cuda"};
    scenario.starts = 0;
    scenario.reports = false;
    check_twin(scenario);
}

TEST_CASE("Program without a GPU to use sees the same when UrgenGo is loaded",
          "[interposer][twins]") {
    Scenario scenario{"init"};
    scenario.reports = false;  // its one launch fails
    check_twin(scenario);
}

TEST_CASE("Forked child and its parent go on when UrgenGo is loaded", "[interposer][twins]") {
    // Both the first child, forked before the first launch, and the parent launch.
    Scenario scenario{"fork"};
    scenario.starts = 2;
    check_twin(scenario);
}

TEST_CASE("Program sees the same when it executes itself", "[interposer][twins]") {
    Scenario scenario{"exec"};
    scenario.starts = 2;
    check_twin(scenario);
}

TEST_CASE("Program exits as usual when work is pending", "[interposer][twins]") {
    check_twin({"exit_pending", 3});
}

TEST_CASE("Program ends at once when it calls _exit with work pending", "[interposer][twins]") {
    Scenario scenario{"exit_at_once", 4};
    scenario.reports = false;
    check_twin(scenario);
}

TEST_CASE("Program exits as usual when other threads launch", "[interposer][twins]") {
    Scenario scenario{"exit_busy", 5};
    scenario.reports = !on_real_gpu();  // where the first launch takes longer than the program
    check_twin(scenario);
}

TEST_CASE("Calls work the same when they are made at exit", "[interposer][twins]") {
    check_twin({"calls_at_exit"});
}

TEST_CASE("Green contexts work the same when UrgenGo is loaded", "[interposer][twins][life]") {
    check_twin({"green_contexts"});
}

TEST_CASE("Context is destroyed as usual when a launch there is held",
          "[interposer][twins][life]") {
    check_twin({"destroyed_held"});
}

TEST_CASE("Device is reset as usual when other threads launch", "[interposer][twins][life]") {
    check_twin({"reset_busy"});
}

TEST_CASE("Calls work the same when their thread is ending", "[interposer][twins][life]") {
    check_twin({"thread_ends"});
}

TEST_CASE("Children run as usual when their parent is scheduled", "[interposer][twins][life]") {
    Scenario scenario{"children"};
    scenario.starts = 3;
    check_twin(scenario);
}

TEST_CASE("Program is replaced as usual when a thread executes another",
          "[interposer][twins][life]") {
    Scenario scenario{"exec_from_thread"};
    scenario.starts = 2;
    check_twin(scenario);
}

TEST_CASE("Program ends as usual when it leaves quickly", "[interposer][twins][life]") {
    Scenario scenario{"quick_exit", 7};
    scenario.reports = false;  // handlers of exit do not run
    check_twin(scenario);
}

TEST_CASE("Calls work the same when handlers of exit make them", "[interposer][twins][life]") {
    check_twin({"exit_order", 8});
}

TEST_CASE("Program is left alone when it never initialises the driver",
          "[interposer][twins][life]") {
    Scenario scenario{"no_init"};
    scenario.starts = 0;
    scenario.reports = false;
    check_twin(scenario);
}

TEST_CASE("Program is left alone when it only looks for devices", "[interposer][twins][life]") {
    Scenario scenario{"only_queries"};
    scenario.starts = 0;
    scenario.reports = false;
    check_twin(scenario);
}

TEST_CASE("Launches block as usual when the environment asks for it", "[interposer][twins][life]") {
    Scenario scenario{"blocking_launches"};
    scenario.environment = {{"CUDA_LAUNCH_BLOCKING", "1"}};
    check_twin(scenario);
    // And the bare run did block: no query found its stream busy.
    const Outcome alone = run_twin({scenario.name}, with(scenario.environment, bare()));
    CHECK(alone.out.find("= 600") == std::string::npos);
    CHECK(run_twin({scenario.name}, bare()).out.find("= 600") != std::string::npos);
}

TEST_CASE("Driver opened by name works the same when it is closed again",
          "[interposer][twins][life]") {
    check_twin({"dlclose"}, TWIN_DLOPEN_PATH);
}

TEST_CASE("Hints change nothing that a program sees when they are given", "[interposer][twins]") {
    check_twin({"hints"});
}

TEST_CASE("Driver opened by name works the same when the program is linked to it",
          "[interposer][twins]") {
    check_twin({"dlopen"});
}

TEST_CASE("Driver opened by name works the same when nothing else names it",
          "[interposer][twins]") {
    // The thread's name is the program's: one that the configs' globs match too.
    check_twin({"dlopen"}, TWIN_DLOPEN_PATH);
}
