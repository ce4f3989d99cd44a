// SPDX-License-Identifier: Apache-2.0
//
// `urgengo top` beside a program under load: for scripts, and on a terminal.
#include <poll.h>
#include <pty.h>
#include <termios.h>

#include "tests/interposer/steered.h"

using namespace urgengo;
using namespace urgengo::testing;
using nlohmann::json;

namespace {

Environment beside(const Steered& program) {
    return {{"PATH", "/usr/bin:/bin"}, {"TERM", "xterm"}, {"URGENGO_SHARE", program.folder()}};
}

/// top on a terminal of its own.
class OnTerminal {
  public:
    explicit OnTerminal(const Environment& environment) {
        winsize size{30, 160, 0, 0};
        child_ = forkpty(&terminal_, nullptr, nullptr, &size);
        REQUIRE(child_ >= 0);
        if (child_ == 0) {
            for (const auto& [name, value] : environment) setenv(name.c_str(), value.c_str(), 1);
            alarm(30);
            const std::string path = placed(URGENGO_PATH);
            execl(path.c_str(), path.c_str(), "top", "--interval", "0.05", nullptr);
            _exit(97);
        }
        REQUIRE(tcgetattr(terminal_, &before_) == 0);
    }
    ~OnTerminal() { close(terminal_); }

    void press(const std::string& keys) {
        REQUIRE(write(terminal_, keys.data(), keys.size()) == static_cast<ssize_t>(keys.size()));
    }
    /// @returns whether the terminal shows that, from the last call on
    bool shows(const std::string& text) {
        shown_.clear();
        const nanoseconds end = monotonic_now() + kLongest;
        while (monotonic_now() < end) {
            read_some();
            if (shown_.find(text) != std::string::npos) return true;
        }
        return false;
    }
    void signal(int number) const { kill(child_, number); }
    int wait() {
        int status = 0;
        while (waitpid(child_, &status, WNOHANG) == 0) read_some();
        read_some();
        return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    }
    /// It has left the alternate screen, and the terminal's settings are what they were.
    bool is_as_it_was() const {
        termios after{};
        return shown_.find("\x1b[?1049l") != std::string::npos &&
               tcgetattr(terminal_, &after) == 0 && after.c_lflag == before_.c_lflag &&
               after.c_iflag == before_.c_iflag && after.c_oflag == before_.c_oflag;
    }

  private:
    void read_some() {
        pollfd waits{terminal_, POLLIN, 0};
        if (poll(&waits, 1, 20) <= 0) return;
        char buffer[4096];
        const ssize_t got = read(terminal_, buffer, sizeof buffer);
        if (got > 0) shown_.append(buffer, static_cast<std::size_t>(got));
    }

    int terminal_ = -1;
    pid_t child_ = -1;
    termios before_{};
    std::string shown_;
};

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
        CHECK(chain.at("tasks").at(0).at("name") == "work");
    }
    CHECK(missed > 0);
    const Outcome text =
        run({URGENGO_PATH, "top", "--once", "--tasks", "--sort", "name"}, beside(program));
    CHECK(text.exit_status == 0);
    for (const char* part : {"twin: enforce", "steered_0", "steered_3", "  work", "last miss"})
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
    OnTerminal top(beside(program));
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
