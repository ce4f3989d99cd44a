// SPDX-License-Identifier: Apache-2.0
//
// urgengo discover and urgengo check from end to end, against the simulated GPU.
#include <map>
#include <nlohmann/json.hpp>

#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo::testing;

namespace {

using Json = nlohmann::json;

Outcome urgengo_cli(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), URGENGO_PATH);
    return run(arguments, {{"PATH", "/usr/bin:/bin"},
                           {"LD_LIBRARY_PATH", SIMGPU_FOLDER},
                           {"TWIN_SIMGPU", SIMGPU_FOLDER "/libcuda.so.1"}});
}

bool has(const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
}

}  // namespace

TEST_CASE("Draft is valid and check finds every chain of it when a program was discovered",
          "[interposer][discover]") {
    const Folder folder;
    const std::string yaml = (folder.path() / "draft.yaml").string();
    const std::vector<std::string> program = {"--", TWIN_PATH, "periodic"};
    std::vector<std::string> discover = {"discover", "-o", yaml, "--keep-trace"};
    discover.insert(discover.end(), program.begin(), program.end());

    const Outcome discovered = urgengo_cli(discover);
    INFO(discovered.err);
    REQUIRE(discovered.exit_status == 0);
    CHECK(discovered.out == "done\n");  // the program's, and nothing of ours
    const std::string draft = read_text(yaml);
    INFO(draft);
    CHECK(has(draft, "{name: \"sensor\", thread: \"sensor\"}"));
    CHECK(has(draft, "{name: \"points\", kernels: \"points\"}"));
    CHECK(has(draft, "{name: \"image\", kernels: \"image\"}"));
    CHECK_FALSE(has(draft, "without GPU times"));
    CHECK(has(draft, "# GPU UrgenGo Simulated GPU"));
    CHECK(std::filesystem::exists(folder.path() / "draft.ugtrace"));

    // A draft is somebody's work once it has been edited.
    CHECK(urgengo_cli(discover).err == "urgengo: " + yaml +
                                           ": found a file, accepted: another name (-o FILE), or "
                                           "--force to replace it\n");

    std::vector<std::string> check = {"check", "-c", yaml};
    check.insert(check.end(), program.begin(), program.end());
    const Outcome checked = urgengo_cli(check);
    INFO(checked.out);
    INFO(checked.err);
    CHECK(checked.exit_status == 0);
    CHECK(has(checked.out, "done\n"));
    for (const char* task : {"sensor/sensor", "points/points", "image/image"}) {
        CHECK(has(checked.out, task));
    }
    CHECK_FALSE(has(checked.out, "NOTHING"));

    // The same for scripts: on stdout there is nothing but JSON.
    check.insert(check.begin() + 1, "--json");
    const Outcome told = urgengo_cli(check);
    CHECK(told.exit_status == 0);
    CHECK(has(told.err, "done\n"));
    const Json matched = Json::parse(told.out);
    CHECK(matched.at("format_version") == 1);
    CHECK(matched.at("config") == yaml);
    CHECK(matched.at("all_matched") == true);
    CHECK(matched.at("gpu_ms") > 0);
    REQUIRE(matched.at("tasks").size() == 3);
    for (const Json& task : matched.at("tasks")) {
        CHECK(task.at("chain") == task.at("task"));
        CHECK(task.at("launches") > 0);
        CHECK(task.at("frames") > 0);
        CHECK(task.at("measured_period_ms") > 0);
        CHECK(task.at("matched_by").size() == 1);
    }
    CHECK(matched.at("claimed_twice").is_array());
    CHECK(matched.at("unexplained").is_array());
    CHECK(matched.at("seen").at("threads").contains("sensor"));

    // The draft is good for a run as it stands.
    std::vector<std::string> run_it = {"run", "-c", yaml};
    run_it.insert(run_it.end(), program.begin(), program.end());
    const Outcome ran = urgengo_cli(run_it);
    CHECK(ran.exit_status == 0);
    CHECK(ran.out == "done\n");
}

TEST_CASE("Discover tells scripts what it has drafted", "[interposer][discover]") {
    const Folder folder;
    const std::string yaml = (folder.path() / "draft.yaml").string();
    const Outcome told =
        urgengo_cli({"discover", "--json", "-o", yaml, "--", TWIN_PATH, "periodic"});
    INFO(told.err);
    REQUIRE(told.exit_status == 0);
    CHECK(has(told.err, "done\n"));
    const Json draft = Json::parse(told.out);
    CHECK(draft.at("format_version") == 1);
    CHECK(draft.at("config") == yaml);
    REQUIRE(draft.at("chains").size() == 3);
    std::map<std::string, Json> rules;
    for (const Json& chain : draft.at("chains")) {
        CHECK(chain.at("period_ms") > 0);
        CHECK(chain.at("period_low_ms") <= chain.at("period_high_ms"));
        CHECK(chain.at("deadline_ms") == chain.at("period_ms"));
        CHECK(chain.at("frames") >= 5);
        REQUIRE(chain.at("tasks").size() == 1);
        rules[chain.at("name")] = chain.at("tasks").at(0).at("found_by");
    }
    CHECK(rules["sensor"] == Json{{"thread", "sensor"}});
    CHECK(rules["points"] == Json{{"kernels", {"points"}}});
}

TEST_CASE("Check fails with the names that were seen when a task matches nothing",
          "[interposer][discover]") {
    const Folder folder;
    const std::string yaml = (folder.path() / "c.yaml").string();
    write_text(yaml,
               "version: 1\nchains:\n  - {name: a, period_ms: 20, deadline_ms: 20, "
               "tasks: [{name: t, thread: \"sensr\"}]}\n");
    const Outcome checked = urgengo_cli({"check", "-c", yaml, "--", TWIN_PATH, "periodic"});
    CHECK(checked.exit_status == 1);
    CHECK(has(checked.out, "Nothing matched a/t:\n  thread: found twin ("));
    CHECK(has(checked.out, "accepted: sensr\n"));
    CHECK(has(checked.out, "GPU time that no task explains: "));
    const Outcome told = urgengo_cli({"check", "--json", "-c", yaml, "--", TWIN_PATH, "periodic"});
    CHECK(told.exit_status == 1);
    const Json json = Json::parse(told.out);
    CHECK(json.at("all_matched") == false);
    CHECK(json.at("tasks").at(0).at("launches") == 0);
    CHECK(json.at("tasks").at(0).at("measured_period_ms").is_null());
    CHECK(json.at("tasks").at(0).at("matched_by").empty());
    CHECK(json.at("unexplained").at(0).at("gpu_ms") > 0);
    CHECK(json.at("seen").at("threads").contains("twin"));
}

TEST_CASE("Discover says what it needs when the program or its driver is of no use",
          "[interposer][discover]") {
    const Folder folder;
    const std::string yaml = (folder.path() / "d.yaml").string();
    const Outcome no_cuda = urgengo_cli({"discover", "-o", yaml, "--", TWIN_PATH, "no_cuda"});
    CHECK(no_cuda.exit_status == 1);
    CHECK(has(no_cuda.err, "no trace was written: it made no CUDA call"));
    const Outcome too_short = urgengo_cli({"discover", "-o", yaml, "--", TWIN_PATH, "copies"});
    CHECK(too_short.exit_status == 1);
    CHECK(has(too_short.err, "found nothing that the program does periodically on the GPU"));
    CHECK_FALSE(std::filesystem::exists(yaml));
    const Outcome no_gpu = run({URGENGO_PATH, "discover", "-o", yaml, "--real-libcuda",
                                "/nonexistent/libcuda.so.1", "--", TWIN_PATH, "periodic"},
                               {{"PATH", "/usr/bin:/bin"}});
    CHECK(no_gpu.exit_status == 1);
    CHECK(has(no_gpu.err, "urgengo: found no GPU, accepted: one that the driver can use ("));
    CHECK(urgengo_cli({"discover"}).err ==
          "urgengo: no program, accepted: urgengo discover [options] -- program [args...], or "
          "--trace FILE of a program that was watched before\n");
    CHECK(urgengo_cli({"check", "-c", yaml}).exit_status == 2);
}
