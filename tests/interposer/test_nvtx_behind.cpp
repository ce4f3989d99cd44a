// SPDX-License-Identifier: Apache-2.0
//
// Another NVTX tool behind UrgenGo: it gets what it would get without us, and so does the program.
#include "tests/interposer/nvtx_recording.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

std::filesystem::path ranged_config(const Folder& folder) {
    config::Task task{"main", ""};
    task.nvtx_glob = "two*";
    return write_config(folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
                        {chain("main", std::chrono::milliseconds(100), {task})}, nullptr,
                        [](config::Config& config) { config.nvtx = config::NvtxEvents::kOff; });
}

Environment behind(Environment environment, const std::string& lacks = "",
                   const std::string& tool = NVTX_RECORDER_PATH) {
    environment = behind_us(std::move(environment), tool);
    environment["NVTX_RECORDER_LACKS"] = lacks;
    return environment;
}

}  // namespace

TEST_CASE("NVTX tool gets the same calls, and gives the same results, when it is behind UrgenGo",
          "[interposer][nvtx]") {
    const Folder folder;
    const auto config = ranged_config(folder);
    for (const std::string lacks : {"", "strings", "payload", "counters", "extensions"}) {
        INFO("the tool lacks " << lacks);
        const Recording expected = record({"nvtx_calls"}, with_recorder(bare(), lacks));
        CHECK(expected.outcome.exit_status == 0);
        CHECK(expected.lines.size() > 40);
        for (const Environment& environment : {configured(behind(preloaded(), lacks), config),
                                               configured(behind(by_library_path(), lacks), config),
                                               configured(behind(bare(), lacks), config)}) {
            const Recording found = record({"nvtx_calls"}, environment);
            CHECK(found.outcome.exit_status == expected.outcome.exit_status);
            CHECK(found.outcome.out == expected.outcome.out);
            CHECK(found.outcome.err == "");
            CHECK(found.lines == expected.lines);
        }
    }
}

TEST_CASE("Recorder finds what breaks NVTX's protocol when a program does", "[interposer][nvtx]") {
    const Recording found = record({"nvtx_calls"}, with_recorder(bare()));
    CHECK(errors_of(found.lines) == std::vector<std::string>{"ERROR pop without a push"});
}

TEST_CASE("Ranges delimit tasks as usual when another NVTX tool is behind UrgenGo",
          "[interposer][nvtx]") {
    const Folder folder;
    config::Task task{"main", ""};
    task.nvtx_glob = "detect";
    const auto config =
        write_config(folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
                     {chain("main", std::chrono::milliseconds(100), {task})});
    const auto instances = [&](const Environment& environment) {
        const auto stats = folder.path() / "stats.json";
        CHECK(run_twin({"nvtx"}, configured(environment, config, stats)).exit_status == 0);
        const std::string text = read_text(stats);
        const auto at = text.find("\"instances\":");
        return text.substr(at, text.find(',', at) - at);
    };
    Environment alone = preloaded();
    alone["NVTX_INJECTION64_PATH"] = INTERPOSER_FOLDER "/libcuda.so.1";
    const std::string expected = instances(alone);
    CHECK(expected.find("20") != std::string::npos);
    CHECK(instances(behind(preloaded())) == expected);
}

TEST_CASE("Program is as without the other NVTX tool, and one line says so, when that is none",
          "[interposer][nvtx]") {
    const Folder folder;
    const auto config = ranged_config(folder);
    Environment alone = preloaded();
    alone["NVTX_INJECTION64_PATH"] = INTERPOSER_FOLDER "/libcuda.so.1";
    const Outcome expected = run_twin({"nvtx_calls"}, configured(alone, config));
    const auto check = [&](const Environment& environment, const std::string& says) {
        const Recording found = record({"nvtx_calls"}, configured(environment, config));
        CHECK(found.outcome.exit_status == 0);
        // Handles are addresses of ours.
        CHECK(lines_of(found.outcome.out).size() == lines_of(expected.out).size());
        REQUIRE(lines_of(found.outcome.err).size() == 1);
        CHECK(found.outcome.err.find(says) != std::string::npos);
        CHECK(errors_of(found.lines).empty());
    };
    check(behind(preloaded(), "", "/no/such/tool.so"),
          "URGENGO_NVTX_TOOL: found '/no/such/tool.so', accepted: an NVTX injection library");
    check(behind(preloaded(), "", FAKE_CUPTI_PATH), "it has no InitializeInjectionNvtx2");
    check(behind(preloaded(), "init"), "the tool behind UrgenGo refused to be initialised");
}
