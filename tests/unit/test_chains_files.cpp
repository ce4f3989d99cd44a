// SPDX-License-Identifier: Apache-2.0
//
// What the workload program writes for UrgenGo, and its handling of files.
#include <stdlib.h>
#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "tests/support/catch.h"
#include "tools/chains/files.h"
#include "tools/chains/scheduler_files.h"
#include "tools/chains/spec.h"

using namespace urgengo::chains;

namespace {

Workload small_workload() {
    Workload workload;
    workload.gpu = "Some GPU";
    workload.driver = "580.159.04";
    Kernel kernel{KernelKind::kCompute, 30, 256, 900, 61.2344, 0.75};
    workload.chains = {
        {"C0", 150, 120, {{"detect3d", 8.7, 13.4, {kernel, kernel}}, {"track", 8.7, 15, {kernel}}}},
        {"C1", 500, 120, {{"calibrate", 11.2, 46.1, {kernel}}}}};
    return workload;
}

/// A folder of its own that goes with the test.
struct TemporaryFolder {
    std::filesystem::path path = std::filesystem::temp_directory_path() / "urgengo_chains_XXXXXX";
    TemporaryFolder() {
        std::string pattern = path.string();
        REQUIRE(mkdtemp(pattern.data()) != nullptr);
        path = pattern;
    }
    ~TemporaryFolder() { std::filesystem::remove_all(path); }
};

}  // namespace

TEST_CASE("format_yaml writes scaled periods and tightened deadlines", "[unit][chains]") {
    const Scenario scenario{0.9, 0.8, {"C0"}};
    const auto yaml =
        YAML::Load(format_yaml(small_workload(), scenario, OnLate::kExit, Threads::kPerChain));
    CHECK(yaml["version"].as<int>() == 1);
    CHECK(yaml["mode"].as<std::string>() == "enforce");
    REQUIRE(yaml["chains"].size() == 2);
    const auto tight = yaml["chains"][0];
    CHECK(tight["name"].as<std::string>() == "C0");
    CHECK(tight["period_ms"].as<double>() == Approx(150 / 0.9));
    CHECK(tight["deadline_ms"].as<double>() == Approx(120 * 0.8 / 2));
    CHECK(tight["on_late"].as<std::string>() == "exit");
    REQUIRE(tight["tasks"].size() == 2);
    CHECK(tight["tasks"][1]["name"].as<std::string>() == "track");
    CHECK(tight["tasks"][1]["thread"].as<std::string>() == "C0");
    CHECK(yaml["chains"][1]["deadline_ms"].as<double>() == Approx(120 * 0.8));
    CHECK_FALSE(tight["arrival"]);
}

TEST_CASE("format_yaml names a thread per task when run has one", "[unit][chains]") {
    const auto yaml =
        YAML::Load(format_yaml(small_workload(), Scenario{}, OnLate::kContinue, Threads::kPerTask));
    CHECK(yaml["chains"][0]["tasks"][0]["thread"].as<std::string>() == "C0.detect3d");
    CHECK(yaml["chains"][0]["on_late"].as<std::string>() == "continue");
}

TEST_CASE("format_profile holds every kernel in launch order", "[unit][chains]") {
    const auto json = nlohmann::json::parse(format_profile(small_workload()));
    const auto expected =
        R"({"format_version": 2, "gpu": "Some GPU", "driver": "580.159.04"})"_json;
    for (const auto& [key, value] : expected.items()) CHECK(json.at(key) == value);
    CHECK(json.at("chains").size() == 2);
    const auto& task = json["chains"][0]["tasks"][0];
    CHECK(task.at("name") == "detect3d");
    CHECK(task.at("cpu_time_ns") == 8'700'000);
    REQUIRE(task.at("kernels").size() == 2);
    CHECK(task["kernels"][1] ==
          R"({"name": "chains_comp", "grid_blocks": 30, "block_threads": 256,
              "gpu_time_ns": 61234, "utilization": 0.75})"_json);
}

TEST_CASE("thread_name fits a thread for every task of the paper", "[unit][chains]") {
    for (const ChainSpec& spec : paper_chains()) {
        for (const TaskSpec& task_spec : spec.tasks) {
            Chain chain;
            chain.name = spec.name;
            Task task;
            task.name = task_spec.name;
            CHECK(thread_name(Threads::kPerTask, chain, task).size() <= 15);
            CHECK(thread_name(Threads::kPerChain, chain, task) == spec.name);
        }
    }
}

TEST_CASE("check_scenario names the chains when a tight one is unknown", "[unit][chains]") {
    CHECK_NOTHROW(check_scenario(Scenario{1, 1, {"C1"}}, small_workload()));
    CHECK_THROWS_WITH(check_scenario(Scenario{1, 1, {"C7"}}, small_workload()),
                      "--tight: found \"C7\", accepted: C0, C1");
}

TEST_CASE("write_file replaces the file and leaves nothing beside it", "[unit][chains]") {
    const TemporaryFolder folder;
    const std::string path = folder.path / "report.json";
    write_file(path, "first, and longer");
    write_file(path, "second");
    CHECK(read_file(path) == "second");
    CHECK(std::distance(std::filesystem::directory_iterator(folder.path), {}) == 1);
}

TEST_CASE("write_file keeps the old file when it cannot write", "[unit][chains]") {
    const TemporaryFolder folder;
    const std::string path = folder.path / "taken";
    std::filesystem::create_directories(folder.path / "taken" / "inside");
    CHECK_THROWS_WITH(write_file(path, "new"),
                      path + ": cannot rename a temporary file to it: Is a directory");
    CHECK(std::filesystem::is_directory(path));
    CHECK(std::distance(std::filesystem::directory_iterator(folder.path), {}) == 1);
}

TEST_CASE("read_file names the file when it is missing", "[unit][chains]") {
    CHECK_THROWS_WITH(read_file("/nonexistent/w.json"),
                      "cannot read /nonexistent/w.json: No such file or directory");
}

TEST_CASE("parse_kernel_driver_version finds the version of either kernel module",
          "[unit][chains]") {
    CHECK(parse_kernel_driver_version(
              "NVRM version: NVIDIA UNIX x86_64 Kernel Module  535.183.01  Sun May 12 2024\n"
              "GCC version:  gcc version 12.2.0 (Debian 12.2.0-14)\n") == "535.183.01");
    CHECK(parse_kernel_driver_version("NVRM version: NVIDIA UNIX Open Kernel Module for x86_64  "
                                      "580.159.04  Release Build  (builder@host)\n") ==
          "580.159.04");
    CHECK(parse_kernel_driver_version("something else 1.2.3 here\n").empty());
}
