// SPDX-License-Identifier: Apache-2.0
//
// `urgengo doctor` and the priority probe of `urgengo run`, against simulated GPUs that honour the
// priority of a launch, ignore it, or refuse it.
#include <nlohmann/json.hpp>

#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr char kYaml[] =
    "version: 1\n"
    "chains:\n"
    "  - {name: main, period_ms: 100, deadline_ms: 100, tasks: [{name: m, thread: twin}]}\n";

Environment with_gpu(const Folder& folder, const std::string& priority) {
    Environment environment = bare();
    environment["XDG_CACHE_HOME"] = (folder.path() / "cache").string();
    environment["SIMGPU_PRIORITY_ATTRIBUTE"] = priority;
    return environment;
}

Outcome urgengo_cli(std::vector<std::string> arguments, const Environment& environment) {
    arguments.insert(arguments.begin(), URGENGO_PATH);
    return run(arguments, environment);
}

/// "warn text" for the topic.
std::string of(const Json& report, const std::string& topic) {
    for (const Json& finding : report.at("findings")) {
        if (finding.at("topic") == topic) {
            return finding.at("verdict").get<std::string>() + " " +
                   finding.at("found").get<std::string>();
        }
    }
    return "no " + topic;
}

/// Answers in the cache folder, which holds copies of our library too.
int num_remembered(const Folder& folder) {
    std::error_code ignored;
    int count = 0;
    for (const auto& entry : fs::directory_iterator(folder.path() / "cache/urgengo", ignored)) {
        if (entry.path().filename().string().rfind("priority-", 0) == 0) ++count;
    }
    return count;
}

std::string priority_via_in(const fs::path& resolved) {
    return Json::parse(read_text(resolved)).at("config").at("scheduler").at("priority_via");
}

}  // namespace

TEST_CASE("Doctor measures which priorities the GPU honours", "[interposer][doctor]") {
    struct Case {
        const char* simulated;
        const char* launch;
        const char* via;
    };
    for (const Case& expected : {Case{"honoured", "ok honoured (", "launch_attribute"},
                                 Case{"ignored", "ok ignored (", "stream_attribute"},
                                 Case{"refused", "ok refused by", "stream_attribute"}}) {
        INFO(expected.simulated);
        const Folder folder;
        const Outcome outcome =
            urgengo_cli({"doctor", "--json"}, with_gpu(folder, expected.simulated));
        INFO(outcome.out + outcome.err);
        CHECK(outcome.exit_status == 0);
        const Json report = Json::parse(outcome.out);
        CHECK(of(report, "priority of a launch").rfind(expected.launch, 0) == 0);
        CHECK(of(report, "priority set on a stream").rfind("ok honoured (", 0) == 0);
        CHECK(of(report, "stream made with priority").rfind("ok honoured (", 0) == 0);
        CHECK(of(report, "stream memory operations").rfind("ok work", 0) == 0);
        CHECK(report.at("priority_via") == expected.via);
    }
}

TEST_CASE("Doctor's exit status tells whether something prevents scheduling",
          "[interposer][doctor]") {
    const Folder folder;
    const std::string yaml = (folder.path() / "c.yaml").string();
    write_text(yaml, kYaml);
    Environment environment = with_gpu(folder, "honoured");
    const Outcome good =
        urgengo_cli({"doctor", "--no-probe", "-c", yaml, "--", TWIN_PATH}, environment);
    INFO(good.out);
    CHECK(good.exit_status == 0);
    CHECK(good.err == "");
    CHECK(good.out.find(TWIN_PATH ": its calls would be seen\n") != std::string::npos);
    CHECK(good.out.find("UrgenGo can schedule here") != std::string::npos);
    CHECK_FALSE(fs::exists(folder.path() / "c.resolved.json"));  // it only looks

    CHECK(urgengo_cli({"doctor", "--no-probe", "--", "/nonexistent"}, environment).exit_status ==
          1);
    write_text(yaml, "version: 2\n");
    const Outcome bad = urgengo_cli({"doctor", "--no-probe", "-c", yaml}, environment);
    CHECK(bad.exit_status == 1);
    CHECK(bad.out.find(yaml + ":1: version: found '2', accepted: 1\n") != std::string::npos);
    CHECK(urgengo_cli({"doctor", "--fast"}, environment).exit_status == 2);
    environment["LD_LIBRARY_PATH"] = "";
    const Outcome none = urgengo_cli({"doctor"}, environment);
    CHECK(none.exit_status == 1);
    CHECK(none.out.find("UrgenGo cannot schedule here") != std::string::npos);
    environment["URGENGO_REAL_LIBCUDA"] = SIMGPU_FOLDER "/libcuda.so.1";
    environment["SIMGPU_FAIL"] = "cuInit:1:100";
    const Outcome no_gpu = urgengo_cli({"doctor"}, environment);
    CHECK(no_gpu.exit_status == 1);
    CHECK(no_gpu.out.find("none that the driver can use: cuInit answers 100\n") !=
          std::string::npos);
}

TEST_CASE("Doctor warns when NVTX tools would find nothing through UrgenGo",
          "[interposer][doctor]") {
    const Folder folder;
    const auto found = [&](Environment environment) {
        environment["XDG_CACHE_HOME"] = (folder.path() / "cache").string();
        const Outcome outcome = urgengo_cli({"doctor", "--no-probe", "--json"}, environment);
        return of(Json::parse(outcome.out), "NVTX tools");
    };
    CHECK(found(bare()) == "no NVTX tools");
    Environment newer = with_driver(bare(), "newer_driver");
    const std::string warning = found(newer);
    INFO(warning);
    CHECK(warning.rfind("warn the driver has cuNvtxGetInjectionInitializer", 0) == 0);
    newer["URGENGO_NEW_NAMES"] = "1";
    CHECK(found(newer) == "no NVTX tools");
}

TEST_CASE("Run measures once what auto stands for, and remembers it", "[interposer][doctor]") {
    const Folder folder;
    const std::string yaml = (folder.path() / "c.yaml").string();
    const fs::path resolved = folder.path() / "c.resolved.json";
    write_text(yaml, kYaml);
    const auto run_true = [&](const std::string& priority, std::vector<std::string> options) {
        options.insert(options.begin(), {"run", "--verbose", "-c", yaml});
        options.insert(options.end(), {"--", "/bin/true"});
        const Outcome outcome = urgengo_cli(options, with_gpu(folder, priority));
        CHECK(outcome.exit_status == 0);
        CHECK(outcome.out == "");
        return outcome.err;
    };
    CHECK(run_true("ignored", {"--no-probe"}) == "");
    CHECK(priority_via_in(resolved) == "launch_attribute");
    CHECK(run_true("ignored", {"--observe"}) == "");
    CHECK(priority_via_in(resolved) == "auto");
    CHECK(num_remembered(folder) == 0);
    const std::string first = run_true("ignored", {});
    INFO(first);
    CHECK(lines_of(first).size() == 1);
    CHECK(first.rfind("urgengo: priority_via: auto is stream_attribute on UrgenGo Simulated GPU: "
                      "on a launch ignored (",
                      0) == 0);
    CHECK(priority_via_in(resolved) == "stream_attribute");
    CHECK(num_remembered(folder) == 1);
    // The GPU has changed, and nobody looks.
    CHECK(run_true("honoured", {}) == "");
    CHECK(priority_via_in(resolved) == "stream_attribute");
    // Until doctor does.
    CHECK(urgengo_cli({"doctor"}, with_gpu(folder, "honoured")).exit_status == 0);
    CHECK(run_true("honoured", {}) == "");
    CHECK(priority_via_in(resolved) == "launch_attribute");

    write_text(yaml, std::string(kYaml) + "scheduler: {priority_via: stream_pool}\n");
    CHECK(run_true("honoured", {}) == "");
    CHECK(priority_via_in(resolved) == "stream_pool");
}

TEST_CASE("Run starts the program all the same when priorities cannot be measured",
          "[interposer][doctor]") {
    const Folder folder;
    const std::string yaml = (folder.path() / "c.yaml").string();
    write_text(yaml, kYaml);
    Environment environment = with_gpu(folder, "ignored");
    environment["SIMGPU_FAIL"] = "cuModuleLoadData:1:209";
    const Outcome outcome =
        urgengo_cli({"run", "--verbose", "-c", yaml, "--", "/bin/sh", "-c", "exit 7"}, environment);
    CHECK(outcome.exit_status == 7);
    CHECK(outcome.err ==
          "urgengo: priority_via: auto is launch_attribute on UrgenGo Simulated GPU: not measured "
          "(cuModuleLoadData answers 209)\n");
    CHECK(priority_via_in(folder.path() / "c.resolved.json") == "launch_attribute");
    CHECK(num_remembered(folder) == 0);
}

TEST_CASE("Statistics of several processes are several files when the name asks for it",
          "[interposer][settings]") {
    const Folder folder;
    const fs::path config =
        write_config(folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
                     {chain("main", std::chrono::seconds(10), {{"m", "twin"}})});
    const fs::path stats = folder.path() / "stats";
    fs::create_directory(stats);
    const Environment environment = configured(preloaded(), config, stats / "s.%p.json");
    for (int i = 0; i < 2; ++i) CHECK(run_twin({"copies"}, environment).exit_status == 0);
    CHECK(std::distance(fs::directory_iterator(stats), {}) == 2);
    CHECK_FALSE(fs::exists(stats / "s.%p.json"));
}
