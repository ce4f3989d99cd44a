// SPDX-License-Identifier: Apache-2.0
//
// The command line tool from outside: what it answers to wrong usage, and programs that it starts
// against the simulated GPU.
#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

constexpr char kYaml[] =
    "version: 1\n"
    "chains:\n"
    "  - {name: main, period_ms: 100, deadline_ms: 100, tasks: [{name: m, thread: twin}]}\n";

/// Nothing but a way to find programs, and the simulated GPU for whoever looks for a driver.
Environment plain() {
    return {{"PATH", "/usr/bin:/bin"}, {"LD_LIBRARY_PATH", SIMGPU_FOLDER}};
}

Outcome urgengo_cli(std::vector<std::string> arguments, const Environment& environment = plain()) {
    arguments.insert(arguments.begin(), URGENGO_PATH);
    return run(arguments, environment);
}

struct Refusal {
    std::vector<std::string> arguments;
    int exit_status;
    std::string err;
};

void check_refused(const Refusal& refusal, const Environment& environment = plain()) {
    const Outcome outcome = urgengo_cli(refusal.arguments, environment);
    INFO(refusal.err);
    CHECK(outcome.exit_status == refusal.exit_status);
    CHECK(outcome.out == "");
    CHECK(outcome.err == "urgengo: " + refusal.err + "\n");
}

}  // namespace

TEST_CASE("Command line is refused with what is accepted when it is not one", "[interposer][cli]") {
    // Every command is listed; the list grows.
    const std::string no_command =
        "urgengo: no such command, accepted: urgengo doctor, urgengo discover, urgengo check, "
        "urgengo profile, "
        "urgengo run, urgengo ctl, urgengo top, urgengo export, urgengo report, urgengo compare, "
        "urgengo trace, "
        "urgengo sim, urgengo bench, urgengo completion";
    const std::string usage = "accepted: urgengo run [options] -- program [args...]";
    for (const std::vector<std::string>& arguments : {std::vector<std::string>{}, {"fly"}}) {
        const Outcome outcome = urgengo_cli(arguments);
        CHECK(outcome.exit_status == 2);
        CHECK(outcome.err.rfind(no_command, 0) == 0);
        CHECK(outcome.err.find("urgengo man") == std::string::npos);  // the build's
    }
    check_refused({{"run"}, 2, "no program, " + usage});
    check_refused({{"run", "-c", "c.yaml", "--"}, 2, "no program, " + usage});
    check_refused({{"run", "/bin/true"}, 2, "found '/bin/true', " + usage});
    check_refused({{"run", "--fast", "--", "/bin/true"}, 2, "unknown option '--fast', " + usage});
    check_refused({{"run", "--mode", "x", "--", "/bin/true"},
                   2,
                   "--mode: found 'x', accepted: off, observe, shadow, enforce"});
}

TEST_CASE("Results are merged by the command line only if they are some", "[interposer][cli]") {
    const Folder folder;
    const std::string file = (folder.path() / "a.json").string();
    write_text(file, "{}");
    const Outcome outcome = urgengo_cli({"bench", "smoke", "--merge", file});
    CHECK(outcome.exit_status == 2);
    CHECK(outcome.out == "");
    CHECK(outcome.err.rfind("urgengo: --merge: " + file + ": found no results of this version",
                            0) == 0);
}

TEST_CASE("Program is refused by the command line when it cannot be started", "[interposer][cli]") {
    const Folder folder;
    const std::string yaml = (folder.path() / "c.yaml").string();
    write_text(yaml, kYaml);
    check_refused(
        {{"run", "-c", yaml, "--", "/nonexistent/p"}, 127, "/nonexistent/p: no such file"});
    check_refused(
        {{"run", "-c", yaml, "--", "no-such-p"}, 127, "no-such-p: no such program in $PATH"});
    check_refused({{"run", "-c", yaml, "--", yaml}, 126, yaml + ": not an executable file"});
    CHECK(urgengo_cli({"run", "-c", yaml, "--", "/bin/sh", "-c", "exit 7"}).exit_status == 7);
}

TEST_CASE("Program finds the driver in its own folder when the command line starts it",
          "[interposer][cli]") {
    const Folder folder;
    const std::string yaml = (folder.path() / "c.yaml").string();
    write_text(yaml, kYaml);
    const Environment no_driver = {{"PATH", "/usr/bin:/bin"}};
    const Outcome alone = run({TWIN_RPATH_PATH, "dlopen"}, no_driver);
    REQUIRE(alone.exit_status == 0);
    CHECK(alone.out.find("= 100") == std::string::npos);  // CUDA_ERROR_NO_DEVICE
    const Outcome outcome =
        urgengo_cli({"run", "-c", yaml, "--", TWIN_RPATH_PATH, "dlopen"}, no_driver);
    CHECK(outcome.exit_status == 0);
    CHECK(outcome.out == alone.out);
    CHECK(outcome.err.find("urgengo: enforce\n") != std::string::npos);  // we were there
}

TEST_CASE("Config is refused by the command line with file and line when it is wrong",
          "[interposer][cli]") {
    const Folder folder;
    const std::string yaml = (folder.path() / "c.yaml").string();
    write_text(yaml,
               "version: 1\nchains:\n  - name: a\n    period_ms: 1\n    deadline_ms: -5\n"
               "    tasks: [{name: t}]\n");
    check_refused({{"run", "-c", yaml, "--", "/bin/true"},
                   2,
                   yaml + ":5: chains[0].deadline_ms: found '-5', accepted: a number > 0 "
                          "(milliseconds)"});
    check_refused({{"run", "-c", "/nonexistent/c.yaml", "--", "/bin/true"},
                   2,
                   "/nonexistent/c.yaml: cannot be read: No such file or directory"});
}

TEST_CASE("Variable is refused by the command line when its value is not accepted",
          "[interposer][cli]") {
    const Folder folder;
    const std::string yaml = (folder.path() / "c.yaml").string();
    write_text(yaml, kYaml);
    Environment environment = plain();
    environment["URGENGO_MODE"] = "x";
    check_refused({{"run", "-c", yaml, "--", "/bin/true"},
                   2,
                   "URGENGO_MODE: found 'x', accepted: off, observe, shadow, enforce"},
                  environment);
    CHECK(urgengo_cli({"run", "-c", yaml, "--mode", "off", "--", "/bin/true"}, environment)
              .exit_status == 0);
    check_refused({{"run", "-c", yaml, "--stats", "/nonexistent/s.json", "--", "/bin/true"},
                   2,
                   "URGENGO_STATS: found '/nonexistent/s.json', accepted: a file that can be "
                   "written (/nonexistent: No such file or directory)"});
}

TEST_CASE("Profile is refused by the command line when it is of another GPU", "[interposer][cli]") {
    const Folder folder;
    const std::string yaml = (folder.path() / "c.yaml").string();
    const std::string profile = (folder.path() / "c.profile.json").string();
    write_text(yaml, kYaml);
    write_text(profile, R"({"format_version":2,"gpu":"Some GPU","driver":"1.0","sm_clock_mhz":1,)"
                        R"("memory_clock_mhz":2,"chains":[]})");
    const std::vector<std::string> command = {"run", "-c", yaml, "--", TWIN_PATH, "copies"};
    const Outcome outcome = urgengo_cli(command);
    CHECK(outcome.exit_status == 2);
    CHECK(outcome.err.rfind(
              "urgengo: " + profile + ": gpu: found 'Some GPU' in the profile, accepted: '", 0) ==
          0);
    std::vector<std::string> stale = command;
    stale.insert(stale.begin() + 1, "--allow-stale");
    const Outcome allowed = urgengo_cli(stale);
    CHECK(allowed.out == run_twin({"copies"}, bare()).out);
    for (const char* warning :
         {"driver: found '1.0' in the profile, accepted: '13.0', as it is here\n",
          "sm_clock: found '1 MHz' in the profile, accepted: '1770 MHz', as it is here\n",
          "memory_clock: found '2 MHz' in the profile, accepted: '9501 MHz', as it is here\n"}) {
        INFO(allowed.err);
        CHECK(allowed.err.find(warning) != std::string::npos);
    }
}
