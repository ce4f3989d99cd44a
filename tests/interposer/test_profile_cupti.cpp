// SPDX-License-Identifier: Apache-2.0
//
// urgengo profile with CUPTI, from end to end: a fake libcupti (fake_cupti.cpp) tells of the
// simulated GPU's kernels.
#include "host/config/profile_reader.h"
#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;

namespace {

constexpr char kYaml[] =
    "version: 1\nchains:\n"
    "  - {name: main, period_ms: 20, deadline_ms: 20, tasks: [{name: s, thread: sensor}]}\n";

struct Profiled {
    Outcome outcome;
    Result<config::Profile> profile = Error{"none was written"};
};

/// @param fails  FAKE_CUPTI
Profiled profile(const std::vector<std::string>& options, const std::string& fails = "") {
    const Folder folder;
    const std::string yaml = (folder.path() / "c.yaml").string();
    write_text(yaml, kYaml);
    std::vector<std::string> arguments = {URGENGO_PATH, "profile", "-c", yaml};
    arguments.insert(arguments.end(), options.begin(), options.end());
    for (const char* part : {"--", TWIN_PATH, "periodic"}) arguments.emplace_back(part);
    Profiled profiled;
    profiled.outcome = run(arguments, {{"PATH", "/usr/bin:/bin"},
                                       {"LD_LIBRARY_PATH", SIMGPU_FOLDER},
                                       {"TWIN_SIMGPU", SIMGPU_FOLDER "/libcuda.so.1"},
                                       {"FAKE_CUPTI", fails}});
    const std::string written = (folder.path() / "c.profile.json").string();
    if (std::filesystem::exists(written)) profiled.profile = config::read_profile(written);
    return profiled;
}

bool has(const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
}

/// The kernels take 100 us each.
void check_times(const Profiled& profiled) {
    INFO(profiled.outcome.err);
    INFO(profiled.outcome.out);
    REQUIRE(profiled.outcome.exit_status == 0);
    REQUIRE(profiled.profile);
    const config::TaskProfile& task = profiled.profile->chains.at(0).tasks.at(0);
    REQUIRE(task.kernels.size() == 2);
    for (const auto& kernel : task.kernels) {
        CHECK(kernel.name == "decode");
        CHECK(kernel.gpu_time >= 95us);
        CHECK(kernel.gpu_time <= 110us);
    }
}

const std::vector<std::string> kFake = {"--cupti", FAKE_CUPTI_PATH};

}  // namespace

TEST_CASE("Profile is by CUPTI when there is one, and latency from a run without",
          "[interposer][profile]") {
    const Profiled profiled = profile(kFake);
    check_times(profiled);
    const config::TaskProfile& task = profiled.profile->chains[0].tasks[0];
    CHECK(has(profiled.outcome.err, "runs again"));
    CHECK_FALSE(has(profiled.outcome.err, "by marks"));
    CHECK(task.kernels[0].launch_time == 0ns);
    CHECK(task.kernels[1].launch_time > 0ns);
    CHECK(task.segments.at(0).latency >= 190us);
}

TEST_CASE("Profile by CUPTI is the same whatever order its records come in",
          "[interposer][profile]") {
    check_times(profile(kFake, "shuffles"));
    check_times(profile(kFake, "runtime"));
}

TEST_CASE("Profile by CUPTI leaves out what lost a record, and says so", "[interposer][profile]") {
    const Profiled dropped = profile(kFake, "drops");
    check_times(dropped);
    CHECK(has(dropped.outcome.err, "CUPTI dropped"));
    CHECK(has(dropped.outcome.err, "launches without a record"));
    const Profiled forgotten = profile(kFake, "forgets");
    check_times(forgotten);
    CHECK(has(forgotten.outcome.err, "launches without a record"));
    const Profiled untimed = profile(kFake, "untimed");
    check_times(untimed);
    CHECK(has(untimed.outcome.err, "launches without a record"));
}

TEST_CASE("Profile falls back to marks and names the reason when CUPTI is held",
          "[interposer][profile]") {
    const Profiled profiled = profile(kFake, "refused");
    REQUIRE(profiled.outcome.exit_status == 0);
    REQUIRE(profiled.profile);
    CHECK(has(profiled.outcome.err,
              "kernels were timed by marks, not by CUPTI: CUPTI is held by another tool"));
}

TEST_CASE("Profile is refused when CUPTI is asked for and cannot be", "[interposer][profile]") {
    std::vector<std::string> options = kFake;
    options.insert(options.end(), {"--source", "cupti"});
    const Profiled profiled = profile(options, "refused");
    CHECK(profiled.outcome.exit_status == 1);
    CHECK(has(profiled.outcome.err, "kernels cannot be timed by CUPTI: CUPTI is held by another"));
    CHECK_FALSE(has(profiled.outcome.err, "runs again"));  // for nothing
    CHECK_FALSE(profiled.profile);
}

TEST_CASE("Profile is by marks, in one run, when that is asked for", "[interposer][profile]") {
    const Profiled profiled = profile({"--source", "marks", "--passes", "1"});
    INFO(profiled.outcome.err);
    REQUIRE(profiled.outcome.exit_status == 0);
    REQUIRE(profiled.profile);
    CHECK_FALSE(has(profiled.outcome.err, "runs again"));
    CHECK_FALSE(has(profiled.outcome.err, "CUPTI"));
    const config::TaskProfile& task = profiled.profile->chains[0].tasks[0];
    CHECK(task.segments.at(0).latency == 0ns);
    // The simulated GPU pauses for 2 us between kernels, which are no kernel's.
    REQUIRE(task.kernels.size() == 2);
    for (const auto& kernel : task.kernels) {
        CHECK(kernel.gpu_time >= 99'500ns);
        CHECK(kernel.gpu_time <= 100'500ns);
    }
}
