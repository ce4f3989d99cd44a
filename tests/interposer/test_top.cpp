// SPDX-License-Identifier: Apache-2.0
//
// `urgengo top` beside a program under load: for scripts, and on a terminal.
#include "tests/interposer/on_terminal.h"
#include "tests/interposer/steered.h"

using namespace urgengo;
using namespace urgengo::testing;
using nlohmann::json;

namespace {

Environment beside(const Steered& program) {
    return {{"PATH", "/usr/bin:/bin"}, {"TERM", "xterm"}, {"URGENGO_SHARE", program.folder()}};
}

OnTerminal top_on_terminal(const Steered& program) {
    return OnTerminal({"top", "--interval", "0.05"}, beside(program));
}

}  // namespace

TEST_CASE("urgengo top tells once, for people and for scripts, and while the program is stopped",
          "[interposer][top]") {
    const Steered program(config::Mode::kEnforce, 2ms);  // which is too short
    program.wait_for_frames(50);
    const bool is_stopped = GENERATE(false, true);
    if (is_stopped) program.stop();
    const Outcome outcome = run({URGENGO_PATH, "top", "--once", "--json"}, beside(program));
    CHECK(outcome.err == "");
    REQUIRE(outcome.exit_status == 0);
    const json process = json::parse(outcome.out).at("processes").at(0);
    CHECK(process.at("program") == "twin");
    CHECK(process.at("process") == (is_stopped ? "stopped" : "there"));
    REQUIRE(process.at("chains").size() == 4);
    std::uint64_t missed = 0;
    int num_priorities = 0;
    for (const json& chain : process.at("chains")) {
        CHECK(chain.at("frames") > 0);
        CHECK(chain.at("launches") > 0);
        CHECK(chain.at("last_minute").at("p99_ms") > 0);
        std::uint64_t caused = 0;
        for (const json& cause : chain.at("causes"))
            caused += cause.at("frames").get<std::uint64_t>();
        // The program may have ended a frame while its page was read.
        CHECK(std::abs(static_cast<std::int64_t>(caused) -
                       chain.at("missed").get<std::int64_t>()) <= 1);
        missed += caused;
        CHECK(chain.at("last_miss").is_null() == (caused == 0));
        const json& task = chain.at("tasks").at(0);
        CHECK(task.at("name") == "work");
        CHECK(task.at("kernels") == 6);
        CHECK(task.at("estimate_factor") > 0);
        CHECK(task.at("priority").is_number());
        num_priorities += task.at("priority") != 0;
        CHECK(task.contains("kernel") == (task.at("state") != "idle"));
        if (task.contains("kernel")) {
            CHECK(task.at("kernel_name") == "wide");
            CHECK(task.at("kernel") >= 1);
            CHECK(task.at("kernel") <= 6);
        }
        CHECK(chain.at("guard") == "enforce");
    }
    CHECK(num_priorities > 0);
    if (is_stopped)
        CHECK(process.at("cores") == 0.0);
    else
        CHECK(process.at("cores") > 0);
    CHECK(process.at("overhead") >= 0);
    CHECK(process.at("overhead") < 1);
    CHECK(process.at("dispatcher").at("gates") == 0);
    CHECK(missed > 0);
    const Outcome text =
        run({URGENGO_PATH, "top", "--once", "--tasks", "--sort", "name"}, beside(program));
    CHECK(text.exit_status == 0);
    for (const char* part : {"twin: enforce", "steered_0", "steered_3", "  work", "last miss",
                             "late because", " cores, holds take "})
        CHECK(text.out.find(part) != std::string::npos);
    CHECK(text.out.find("steered_0") < text.out.find("steered_3"));
    if (is_stopped) program.signal(SIGCONT);
}

TEST_CASE("urgengo top says what is wrong", "[interposer][top]") {
    const Folder folder;
    const Environment environment{{"PATH", "/usr/bin:/bin"},
                                  {"URGENGO_SHARE", folder.path().string()}};
    const auto top = [&](std::vector<std::string> arguments) {
        arguments.insert(arguments.begin(), {URGENGO_PATH, "top"});
        return run(arguments, environment);
    };
    CHECK(top({"--once"}).out == "no process under UrgenGo\n");
    CHECK(json::parse(top({"--once", "--json"}).out).at("processes").empty());
    CHECK(top({"--once", "--pid", "1"}).exit_status == 1);
    CHECK(top({}).exit_status == 2);  // no terminal
    CHECK(top({}).err == "urgengo: top: found no terminal, accepted: a terminal, or --once\n");
    CHECK(top({"--json"}).exit_status == 2);
    CHECK(top({"--once", "--sort", "beauty"}).exit_status == 2);
}

TEST_CASE("urgengo top takes keys, and leaves the terminal as it was", "[interposer][top]") {
    const Steered program;
    OnTerminal top = top_on_terminal(program);
    REQUIRE(top.shows("steered_2"));
    top.press("s");
    CHECK(top.shows("name"));
    top.press("r");
    CHECK(top.shows("reversed"));
    top.press("p");
    CHECK(top.shows("PAUSED"));
    top.press("h");
    CHECK(top.shows("this help"));
    top.press("x");
    CHECK(top.shows("steered_2"));
    SECTION("on a narrow terminal, too") {
        OnTerminal narrow({"top", "--interval", "0.05"}, beside(program), 80);
        CHECK(narrow.shows("laxity"));
        narrow.press("q");
        CHECK(narrow.wait() == 0);
        top.press("q");
        CHECK(top.wait() == 0);
    }
    SECTION("when the user ends it") {
        top.press("q");
        CHECK(top.wait() == 0);
    }
    SECTION("when a signal does") {
        top.signal(GENERATE(SIGINT, SIGTERM, SIGHUP));
        CHECK(top.wait() == 0);
    }
    CHECK(top.is_as_it_was());
}
