// SPDX-License-Identifier: Apache-2.0
//
// URGENGO_LOG: the program does what it does without it, and the file tells what UrgenGo did.
#include <filesystem>

#include "tests/interposer/check_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;

namespace {

std::string only_file_of(const std::filesystem::path& folder) {
    std::string text;
    int files = 0;
    for (const auto& file : std::filesystem::directory_iterator(folder)) {
        text = read_text(file.path());
        ++files;
    }
    CHECK(files == 1);
    return text;
}

}  // namespace

TEST_CASE("Programs do the same when UrgenGo writes its log", "[interposer][log]") {
    const Folder folder;
    const Environment logs{{"URGENGO_LOG", "debug"}, {"URGENGO_LOG_FILE", folder.path("%p.log")}};
    for (const char* name : {"copies", "streams", "errors", "modules"}) {
        Scenario scenario{name};
        scenario.environment = logs;
        check_twin(scenario);
    }
    CHECK_FALSE(std::filesystem::is_empty(folder.path()));
}

TEST_CASE("Log tells how UrgenGo started, why tasks have no plan, and why frames were late",
          "[interposer][log]") {
    const Folder folder, logs;
    const auto config = write_config(folder.path() / "config.json", "urgengo",
                                     config::Mode::kEnforce, {chain("main", 1us, {{"m", "twin"}})});
    Environment environment = configured(preloaded(), config, folder.path() / "stats.json");
    environment["URGENGO_LOG_FILE"] = logs.path("%p.log");
    const bool is_debug = GENERATE(false, true);
    environment["URGENGO_LOG"] = is_debug ? "debug" : "info";
    environment["URGENGO_SUMMARY"] = "perhaps";
    const Outcome outcome = run_twin({"copies"}, environment);
    CHECK(outcome.exit_status == 0);
    const std::string text = only_file_of(logs.path());
    INFO(text);
    const auto tells = [&](const std::string& part) {
        return text.find(part) != std::string::npos;
    };
    CHECK(tells("UrgenGo 0.1.0 in process "));
    CHECK(tells(": mode enforce, 1 chains, config " + config.string()));
    CHECK(tells("CUDA_DEVICE_MAX_CONNECTIONS not set"));
    CHECK(tells("task 'm' of chain 'main' has no plan: the config has no profile"));
    CHECK(tells("URGENGO_SUMMARY: found 'perhaps', accepted: 0, 1"));  // as on stderr
    CHECK(outcome.err == "urgengo: URGENGO_SUMMARY: found 'perhaps', accepted: 0, 1\n");
    CHECK(tells("the program ends; mode enforce"));
    CHECK(tells("of 'main' missed, ") == is_debug);
}

TEST_CASE("No log is written unless it is asked for, and one line says why when it cannot be",
          "[interposer][log]") {
    const Folder folder;
    const auto config = write_config(folder.path() / "config.json", "urgengo",
                                     config::Mode::kEnforce, {chain("main", 10s, {{"m", "twin"}})});
    const std::string expected = run_twin({"copies"}, bare()).out;
    Environment environment = configured(preloaded(), config);
    environment["URGENGO_LOG_FILE"] = folder.path("none/own.log");
    Outcome outcome = run_twin({"copies"}, environment);
    CHECK(outcome.out == expected);
    CHECK(outcome.err == "");
    environment["URGENGO_LOG"] = "info";
    outcome = run_twin({"copies"}, environment);
    CHECK(outcome.out == expected);
    CHECK(outcome.err == "urgengo: URGENGO_LOG_FILE: " + folder.path("none/own.log") +
                             ": cannot be written: No such file or directory; no log is written\n");
}
