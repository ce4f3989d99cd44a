// SPDX-License-Identifier: Apache-2.0
//
// The profile: what is accepted, and the exact line that each mistake gets.
#include "host/config/profile_reader.h"

#include <nlohmann/json.hpp>
#include <string>

#include "host/config/profile_json.h"
#include "host/config/profile_match.h"

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

Profile full_profile() {
    Profile profile;
    profile.gpu = "NVIDIA H200";
    profile.driver = "13.0";
    profile.sm_clock_mhz = 1980;
    profile.memory_clock_mhz = 3201;
    profile.program = "my_stack";
    profile.kernel_set_hash = 0x00ab'0000'0000'0001;
    profile.runs = 3;
    TaskProfile task{
        "detect", 5us, {{"conv", 392, 256, 7us, 1.0 / 3, 40}, {"gemm", 1, 32, 0ns, 1}}};
    task.segments = {{4us, 1, 1, 2, "stream"}, {1us, 1, 0, 1, "event"}};
    task.sizes = {{"conv", 196, 256, 3us, 0.25, 12}};
    task.instances = 20;
    task.start_up_launches = 7;
    profile.chains = {ChainProfile{"C0", {task, TaskProfile{"track", 0ns}}}};
    return profile;
}

TEST_CASE("Profile is the same when written and read back", "[unit][config]") {
    const std::string text = to_profile_text(full_profile());
    const auto read = parse_profile(text, "p.json");
    REQUIRE(read);
    CHECK(to_profile_text(*read) == text);
    CHECK(read->sm_clock_mhz == 1980);
    CHECK(read->memory_clock_mhz == 3201);
    CHECK(read->program == "my_stack");
    CHECK(read->kernel_set_hash == 0x00ab'0000'0000'0001);
    CHECK(read->runs == 3);
    REQUIRE(read->chains.size() == 1);
    REQUIRE(read->chains[0].tasks.size() == 2);
    const TaskProfile& task = read->chains[0].tasks[0];
    CHECK(task.instances == 20);
    CHECK(task.start_up_launches == 7);
    CHECK(task.kernels[0].utilization == 1.0 / 3);  // to the bit
    CHECK(task.kernels[0].samples == 40);
    REQUIRE(task.segments.size() == 2);
    CHECK(task.segments[0].cpu_time == 4us);
    CHECK(task.segments[0].num_launches == 1);
    CHECK(task.segments[0].min_launches == 1);
    CHECK(task.segments[0].max_launches == 2);
    CHECK(task.segments[1].closed_by == "event");
    REQUIRE(task.sizes.size() == 1);
    CHECK(task.sizes[0].grid_blocks == 196);
}

TEST_CASE("Profile's text has one kernel a line when a person reads it", "[unit][config]") {
    const std::string text = to_profile_text(full_profile());
    CHECK_THAT(text, Catch::Matchers::StartsWith("{\n  \"format_version\": 2,\n  \"gpu\": "
                                                 "\"NVIDIA H200\",\n"));
    CHECK(text.find("\n  \"kernel_set_hash\": \"00ab000000000001\",\n") != std::string::npos);
    CHECK(text.find("\n            {\"name\":\"gemm\",\"grid_blocks\":1,\"block_threads\":32,"
                    "\"gpu_time_ns\":0,\"utilization\":1.0,\"samples\":0,"
                    "\"launch_ns\":0,\"stream\":0}\n") != std::string::npos);
    Profile odd;
    odd.program = "\xff\"\n";
    CHECK(parse_profile(to_profile_text(odd), "p.json"));
}

TEST_CASE("Profile is refused with the reason when the GPU or the program is another",
          "[unit][config]") {
    const Profile profile = full_profile();
    const RunTarget same{"NVIDIA H200", "13.0", 1980, 3201, "my_stack"};
    CHECK(profile_matches(profile, same).refusals.empty());
    CHECK(profile_matches(profile, same).warnings.empty());

    const ProfileMatch other =
        profile_matches(profile, {"NVIDIA L4", "12.4", 2040, 6251, "other_stack"});
    CHECK(other.refusals ==
          std::vector<std::string>{
              "gpu: found 'NVIDIA H200' in the profile, accepted: 'NVIDIA L4', as it is here",
              "program: found 'my_stack' in the profile, accepted: 'other_stack', as it is here"});
    CHECK(
        other.warnings ==
        std::vector<std::string>{
            "driver: found '13.0' in the profile, accepted: '12.4', as it is here",
            "sm_clock: found '1980 MHz' in the profile, accepted: '2040 MHz', as it is here",
            "memory_clock: found '3201 MHz' in the profile, accepted: '6251 MHz', as it is here"});

    CHECK(profile_matches(Profile{}, {"G", "1", 1, 1, "p"}).refusals.empty());  // it does not say
    CHECK(profile_matches(profile, {}).refusals.empty());                       // nobody knows
    CHECK(profile_matches(profile, {}).warnings.empty());
}

TEST_CASE("Profile takes defaults and ignores what it does not know when keys differ",
          "[unit][config]") {
    const auto profile = parse_profile(profile_text("\"gpu\"", "\"note\":\"mine\",\"gpu\""), "p");
    REQUIRE(profile);
    CHECK(profile->runs == 1);
    CHECK(profile->kernel_set_hash == 0);
    CHECK(profile->program.empty());
    CHECK(profile->chains[0].tasks[0].segments.empty());
    CHECK(profile->chains[0].tasks[0].kernels[0].samples == 0);
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
    CHECK(error_of(profile_text("\"gpu\"", "\"kernel_set_hash\":12,\"gpu\"")) ==
          "p.json: $.kernel_set_hash: found '12', accepted: a string");
    CHECK(error_of(profile_text("\"gpu\"", "\"kernel_set_hash\":\"12\",\"gpu\"")) ==
          "p.json: $.kernel_set_hash: found '\"12\"', accepted: 16 hexadecimal digits");
    CHECK(error_of(profile_text("\"gpu\"", "\"runs\":-1,\"gpu\"")) ==
          "p.json: $.runs: found '-1', accepted: an integer from 0 to 4294967295");
    CHECK(error_of(profile_text("\"kernels\"",
                                "\"segments\":[{\"cpu_time_ns\":0,\"num_launches\":1,"
                                "\"min_launches\":2,\"max_launches\":1,\"closed_by\":\"\"}],"
                                "\"kernels\"")) ==
          "p.json: $.chains[0].tasks[0].segments[0].max_launches: found '1', accepted: an integer "
          "from 2 to 4294967295");
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
