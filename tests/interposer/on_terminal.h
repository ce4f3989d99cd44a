// SPDX-License-Identifier: Apache-2.0
//
// A command of `urgengo` on a terminal of its own.
#pragma once

#include <poll.h>
#include <pty.h>
#include <sys/wait.h>
#include <termios.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <string>
#include <vector>

#include "host/base/clock.h"
#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

namespace urgengo::testing {

class OnTerminal {
  public:
    /// @param arguments  of `urgengo`
    OnTerminal(std::vector<std::string> arguments, const Environment& environment,
               unsigned short columns = 160) {
        winsize size{30, columns, 0, 0};
        arguments.insert(arguments.begin(), placed(URGENGO_PATH));
        std::vector<char*> words;
        for (std::string& argument : arguments) words.push_back(argument.data());
        words.push_back(nullptr);
        // As a new terminal is. Asked afterwards, the program might have changed it already.
        int other = -1;
        REQUIRE(openpty(&terminal_, &other, nullptr, nullptr, nullptr) == 0);
        REQUIRE(tcgetattr(terminal_, &before_) == 0);
        close(other);
        close(terminal_);
        child_ = forkpty(&terminal_, nullptr, &before_, &size);
        REQUIRE(child_ >= 0);
        if (child_ == 0) {
            for (const auto& [name, value] : environment) setenv(name.c_str(), value.c_str(), 1);
            alarm(30);
            execv(words[0], words.data());
            _exit(97);
        }
    }
    ~OnTerminal() { close(terminal_); }
    OnTerminal(const OnTerminal&) = delete;
    OnTerminal& operator=(const OnTerminal&) = delete;

    void press(const std::string& keys) {
        REQUIRE(write(terminal_, keys.data(), keys.size()) == static_cast<ssize_t>(keys.size()));
    }
    /// @returns whether the terminal shows that, from the last call on
    bool shows(const std::string& text) {
        shown_.clear();
        const nanoseconds end = monotonic_now() + kPatience;
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
        while (read_some()) {
        }
        return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    }
    /// @returns what it has shown since the last call of shows()
    const std::string& shown() const { return shown_; }
    /// It has left the alternate screen, and the terminal's settings are what they were.
    bool is_as_it_was() const {
        termios after{};
        return shown_.find("\x1b[?1049l") != std::string::npos &&
               tcgetattr(terminal_, &after) == 0 && after.c_lflag == before_.c_lflag &&
               after.c_iflag == before_.c_iflag && after.c_oflag == before_.c_oflag;
    }

  private:
    static constexpr std::chrono::seconds kPatience{10};  // the machine may be busy

    /// @returns whether there was something
    bool read_some() {
        pollfd waits{terminal_, POLLIN, 0};
        if (poll(&waits, 1, 20) <= 0) return false;
        char buffer[4096];
        const ssize_t got = read(terminal_, buffer, sizeof buffer);
        if (got > 0) shown_.append(buffer, static_cast<std::size_t>(got));
        return got > 0;
    }

    int terminal_ = -1;
    pid_t child_ = -1;
    termios before_{};
    std::string shown_;
};

}  // namespace urgengo::testing
