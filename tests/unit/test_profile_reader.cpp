// SPDX-License-Identifier: Apache-2.0
//
// The profile: what is accepted, and the exact line that each mistake gets.
#include "host/config/profile_reader.h"

#include <string>

#include "tests/support/catch.h"

namespace urgengo::config {
namespace {

using namespace std::chrono_literals;

/// A profile of one kernel, with `from` replaced by `to`.
std::string profile_text(const std::string& from = "", const std::string& to = "") {
    std::string text = R"({"format_version":2,"gpu":"G","driver":"580",
"chains":[{"name":"C0","tasks":[{"name":"detect","cpu_time_ns":1000,"kernels":[
{"name":"conv","grid_blocks":10,"block_threads":256,"gpu_time_ns":2000,"utilization":0.5}]}]}]})";
    if (!from.empty()) text.replace(text.find(from), from.size(), to);
    return text;
}

std::string error_of(const std::string& text) {
    const auto profile = parse_profile(text, "p.json");
    return profile ? "no error" : profile.error();
}

TEST_CASE("Profile reads every key when all are there", "[unit][config]") {
    const auto profile = parse_profile(profile_text(), "p.json");
    REQUIRE(profile);
    CHECK(profile->gpu == "G");
    CHECK(profile->driver == "580");
    REQUIRE(profile->chains.size() == 1);
    REQUIRE(profile->chains[0].tasks.size() == 1);
    const TaskProfile& task = profile->chains[0].tasks[0];
    CHECK(task.name == "detect");
    CHECK(task.cpu_time == 1us);
    REQUIRE(task.kernels.size() == 1);
    CHECK(task.kernels[0].name == "conv");
    CHECK(task.kernels[0].grid_blocks == 10);
    CHECK(task.kernels[0].block_threads == 256);
    CHECK(task.kernels[0].gpu_time == 2us);
    CHECK(task.kernels[0].utilization == 0.5);
}

TEST_CASE("Profile error names JSON path, found and accepted when a value is wrong",
          "[unit][config]") {
    const std::string kernel = "p.json: $.chains[0].tasks[0].kernels[0].";
    CHECK(error_of(profile_text("0.5", "1.5")) ==
          kernel + "utilization: found '1.5', accepted: a number from 0.0 to 1.0");
    CHECK(error_of(profile_text("0.5", "\"x\"")) ==
          kernel + "utilization: found '\"x\"', accepted: a number from 0.0 to 1.0");
    CHECK(error_of(profile_text("256", "2048")) ==
          kernel + "block_threads: found '2048', accepted: an integer from 1 to 1024");
    CHECK(error_of(profile_text("2000", "-1")) ==
          kernel + "gpu_time_ns: found '-1', accepted: an integer from 0 to 86400000000000");
    CHECK(error_of(profile_text("2000", "18446744073709551615")) ==
          kernel +
              "gpu_time_ns: found '18446744073709551615', accepted: an integer from 0 to "
              "86400000000000");
    CHECK(error_of(profile_text("2000", "2.5")) ==
          kernel + "gpu_time_ns: found '2.5', accepted: an integer from 0 to 86400000000000");
    CHECK(error_of(profile_text("\"conv\"", "\"\"")) ==
          kernel + "name: found '\"\"', accepted: a string that is not empty");
    CHECK(error_of(profile_text("\"format_version\":2", "\"format_version\":1")) ==
          "p.json: $.format_version: found '1', accepted: an integer from 2 to 2");
    CHECK(error_of(profile_text("\"G\"", "{}")) ==
          "p.json: $.gpu: found an object, accepted: a string");
    CHECK(error_of("[]") == "p.json: $: found an array, accepted: an object");
    CHECK(error_of(profile_text("\"cpu_time_ns\":1000,", "")) ==
          "p.json: $.chains[0].tasks[0].cpu_time_ns: missing, and required");
    CHECK(error_of(R"({"format_version":2,"gpu":"","driver":"","chains":{}})") ==
          "p.json: $.chains: found an object, accepted: an array");
}

TEST_CASE("Profile error names line and column when the JSON has a syntax error",
          "[unit][config]") {
    CHECK_THAT(error_of("{\n  \"gpu\": ,\n}"),
               Catch::Matchers::StartsWith("p.json:2:10: not valid JSON: "));
    CHECK_THAT(error_of(""), Catch::Matchers::StartsWith("p.json:1:1: not valid JSON: "));
    CHECK_THAT(error_of("1e999"), Catch::Matchers::StartsWith("p.json: not valid JSON: "));
    CHECK(read_profile("/nonexistent/p.json").error() ==
          "/nonexistent/p.json: cannot be read: No such file or directory");
}

TEST_CASE("Profile warnings name what only one side knows when config and profile differ",
          "[unit][config]") {
    Config config;
    config.chains = {Chain{"C0", 1ms, 1ms, OnLate::kContinue, {{"detect", ""}, {"track", ""}}},
                     Chain{"C1", 1ms, 1ms, OnLate::kContinue, {{"plan", ""}}}};
    Profile profile;
    profile.chains = {ChainProfile{"C0", {{"detect", 0ns, {}}, {"fuse", 0ns, {}}}},
                      ChainProfile{"C9", {}}};
    CHECK(profile_warnings(config, profile) ==
          std::vector<std::string>{
              "task 'track' of chain 'C0' is not in the profile",
              "chain 'C1' is not in the profile",
              "task 'fuse' of chain 'C0' is in the profile but not in the config",
              "chain 'C9' is in the profile but not in the config",
          });
    CHECK(profile_warnings(Config{}, Profile{}).empty());
}

}  // namespace
}  // namespace urgengo::config
