// SPDX-License-Identifier: Apache-2.0
//
// `urgengo compare` of programs on the simulated GPU. What its numbers are worth is tested apart
// (test_paired_blocks.cpp).
#include "tests/interposer/steered.h"

using namespace urgengo;
using namespace urgengo::testing;
using nlohmann::json;

namespace {

constexpr char kYaml[] =
    "version: 1\n"
    "chains:\n"
    "  - {name: steered_0, period_ms: 20, deadline_ms: 20, tasks: [{name: work}]}\n"
    "  - {name: steered_1, period_ms: 40, deadline_ms: 40, tasks: [{name: work, thread: "
    "steered_1}]}\n";

Environment beside(const std::string& folder) {
    Environment environment = bare();
    environment["PATH"] = "/usr/bin:/bin";
    environment["URGENGO_SHARE"] = folder;
    return environment;
}

std::vector<std::string> compare(std::vector<std::string> options) {
    const std::vector<std::string> before{URGENGO_PATH, "compare", "--quiet", "--warm-up", "0"};
    options.insert(options.begin(), before.begin(), before.end());
    return options;
}

const json& row(const json& found, const std::string& of, const std::string& measure) {
    for (const json& each : found.at("rows"))
        if (each.at("of") == of && each.at("measure") == measure) return each;
    FAIL("no row of " << of << ", " << measure);
    throw 0;
}

}  // namespace

TEST_CASE("A mode compared with itself differs no more than by chance, and is what it was after it",
          "[interposer][compare]") {
    Steered program;
    const std::string pid = std::to_string(program.page().process.process);
    json found;
    // One of twenty finds a difference by chance.
    for (int tries = 0; tries < 3; ++tries) {
        const Outcome outcome =
            run(compare({"--pid", pid, "--with", "observe", "--against", "observe", "--block",
                         "0.2", "--blocks", "12", "--json"}),
                beside(program.folder()));
        INFO(outcome.err);
        REQUIRE(outcome.exit_status == 0);
        found = json::parse(outcome.out);
        if (!found.at("finds_difference").get<bool>()) break;
    }
    CHECK_FALSE(found.at("finds_difference").get<bool>());
    CHECK(found.at("note") == "");
    CHECK(found.at("rows").size() == 4 * 2 + 2 + 1);
    for (int i = 0; i < 4; ++i) {
        const json& of_chain = row(found, "steered_" + std::to_string(i), "latency");
        CHECK(of_chain.at("pairs") == 6);
        CHECK(of_chain.at("frames").at(0) > 0);
        CHECK(of_chain.at("frames").at(1) > 0);
        CHECK(of_chain.at("value").at(0) > 0);
        CHECK(of_chain.at("interval").at(0) <= of_chain.at("difference"));
        CHECK(of_chain.at("difference") <= of_chain.at("interval").at(1));
    }
    CHECK(program.page().mode == abi::StatusMode::kEnforce);
    CHECK(program.end().exit_status == 0);
}

TEST_CASE("Comparison that is interrupted tells what there is, and leaves the program on",
          "[interposer][compare]") {
    const Steered program;
    const std::string pid = std::to_string(program.page().process.process);
    Running comparison(compare({"--pid", pid, "--block", "0.1", "--blocks", "1000"}),
                       beside(program.folder()));
    const nanoseconds end = monotonic_now() + kLongest;
    while (program.page().mode != abi::StatusMode::kObserve && monotonic_now() < end)
        std::this_thread::sleep_for(1ms);
    kill(comparison.process(), SIGINT);
    const Outcome outcome = comparison.wait();
    CHECK(outcome.exit_status == 0);
    CHECK(outcome.err == "");
    CHECK(outcome.out.find("interrupted") != std::string::npos);
    CHECK(outcome.out.find("too few pairs") != std::string::npos);
    CHECK(program.page().mode == abi::StatusMode::kEnforce);
    program.wait_for_frames(5);
}

TEST_CASE("Program that is started to be compared is ended after the last block",
          "[interposer][compare]") {
    const MemoryFolder folder;
    const std::string yaml = (folder.path() / "c.yaml").string();
    write_text(yaml, kYaml);
    int ends[2];
    REQUIRE(pipe2(ends, O_CLOEXEC) == 0);
    const std::string with = GENERATE("observe", "shadow", "off");
    Running comparison(compare({"-c", yaml, "--with", with, "--block", "0.1", "--blocks", "12",
                                "--json", "--seed", "3", "--", TWIN_PATH, "steered"}),
                       beside(folder.path().string()), Running::kLongest_s, ends[0]);
    close(ends[0]);
    const Outcome outcome = comparison.wait();
    close(ends[1]);
    INFO(outcome.err);
    REQUIRE(outcome.exit_status == 0);
    const json found = json::parse(outcome.out);
    CHECK(found.at("a") == with);
    CHECK(found.at("b") == "on");
    CHECK(found.at("seed") == 3);
    CHECK(row(found, "process", "CPU").at("pairs") == 6);
    // Nothing is counted while UrgenGo is off.
    CHECK(found.at("rows").size() == (with == "off" ? 1 : 2 * 2 + 2 + 1));
    CHECK(cli::find_pages(folder.path().string()).empty());
}

TEST_CASE("Whole runs are compared with bare ones", "[interposer][compare]") {
    const MemoryFolder folder;
    const std::string yaml = (folder.path() / "c.yaml").string();
    write_text(yaml, kYaml);
    const Outcome outcome = run(compare({"-c", yaml, "--with-bare", "--against", "observe",
                                         "--blocks", "12", "--json", "--", TWIN_PATH, "streams"}),
                                beside(folder.path().string()));
    INFO(outcome.err);
    REQUIRE(outcome.exit_status == 0);
    const json found = json::parse(outcome.out);
    CHECK(found.at("a") == "bare");
    CHECK(found.at("b") == "observe");
    CHECK(row(found, "process", "time").at("pairs") == 6);
    CHECK(row(found, "process", "CPU").at("value").at(1) > 0);
}

TEST_CASE("Comparison says what is wrong", "[interposer][compare]") {
    const MemoryFolder folder;
    const auto refused = [&](std::vector<std::string> options, const std::string& why) {
        const Outcome outcome = run(compare(std::move(options)), beside(folder.path().string()));
        CHECK(outcome.exit_status != 0);
        CHECK(outcome.out == "");
        INFO(outcome.err);
        CHECK(outcome.err.find(why) != std::string::npos);
    };
    refused({}, "no program, accepted: urgengo compare [options] -- program [args...], or --pid N");
    refused({"--pid", "1"}, "found no process 1 under UrgenGo");
    refused({"--pid", "1", "--", "/bin/true"}, "--pid and a program, accepted: one of them");
    refused({"--with-bare", "--against", "off", "--", "/bin/true"},
            "accepted: observe, shadow or on");
    const std::string yaml = (folder.path() / "c.yaml").string();
    write_text(yaml, kYaml);
    refused({"-c", yaml, "--", "/bin/true"},
            "has ended with exit code 0 before it launched anything");
    refused({"-c", yaml, "--with-bare", "--", "/bin/false"}, "a run ended with exit code 1");
}
