// SPDX-License-Identifier: Apache-2.0
//
// A program under load (scenario_steered.cpp) that is looked at, and steered, from outside.
#pragma once

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstddef>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "host/base/clock.h"
#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"
#include "tools/urgengo/page/control.h"
#include "tools/urgengo/page/find_pages.h"

namespace urgengo::testing {

using namespace std::chrono_literals;

inline constexpr auto kLongest = 5s;  // of an answer: the machine may be busy

/// The program, until its input is closed.
class Steered {
  public:
    /// @param deadline  of the first chain; the others' are as many times longer
    explicit Steered(config::Mode mode = config::Mode::kEnforce, nanoseconds deadline = 20ms) {
        const auto config = write(mode, "config.json", deadline);
        Environment environment = configured(preloaded(), config, folder_.path() / "stats.json");
        environment["URGENGO_SHARE"] = folder_.path().string();
        int ends[2];
        REQUIRE(pipe2(ends, O_CLOEXEC) == 0);
        program_.emplace(std::vector<std::string>{TWIN_PATH, "steered"}, environment, 600, ends[0]);
        close(ends[0]);
        input_ = ends[1];
        const nanoseconds end = monotonic_now() + kLongest;
        while (stem_.empty() && monotonic_now() < end) {
            const auto stems = observe::list_pages(folder_.path().string());
            if (!stems.empty()) stem_ = stems[0];
            std::this_thread::sleep_for(1ms);
        }
        REQUIRE_FALSE(stem_.empty());
        wait_for_frames(5);
    }
    ~Steered() {
        if (input_ >= 0) close(input_);
    }

    /// @param deadline, change  what is other in it than in the one that it was started with
    /// @returns the path of another config for it
    std::string write(config::Mode mode, const std::string& file, nanoseconds deadline,
                      const std::function<void(config::Config&)>& change = {}) const {
        std::vector<config::Chain> chains;
        config::Profile profile;
        config::TaskProfile task;
        task.name = "work";
        for (int i = 0; i < 6; ++i) task.kernels.push_back({"wide", 46, 1024, 300us, 1.0});
        for (int i = 0; i < 4; ++i) {
            const std::string name = "steered_" + std::to_string(i);
            chains.push_back(chain(name, (i + 1) * deadline, {{"work", i % 2 == 0 ? "" : name}}));
            profile.chains.push_back({name, {task}});
        }
        return write_config(folder_.path() / file, "urgengo", mode, chains, &profile,
                            [&](config::Config& config) {
                                config.scheduler.guard = false;
                                if (change) change(config);
                            })
            .string();
    }

    Outcome end() {
        close(std::exchange(input_, -1));
        return program_->wait();
    }
    void signal(int number) const { REQUIRE(kill(program_->process(), number) == 0); }
    /// All of its threads are stopped when this returns.
    void stop() const {
        signal(SIGSTOP);
        int status = 0;
        REQUIRE(waitpid(program_->process(), &status, WUNTRACED) == program_->process());
        REQUIRE(WIFSTOPPED(status));
    }
    cli::PageReading page() const {
        auto page = cli::read_page(stem_, monotonic_now());
        REQUIRE(page);
        return *page;
    }
    /// Of those that the last word was to end, as of when it was answered.
    std::uint32_t holds_left() const {
        const std::string path = stem_ + observe::kPageSuffix;
        const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
        REQUIRE(fd >= 0);
        std::uint32_t left = 0;
        const ssize_t bytes = pread(fd, static_cast<void*>(&left), sizeof left,
                                    offsetof(abi::StatusHeader, holds_left));
        close(fd);
        REQUIRE(bytes == sizeof left);
        return left;
    }
    std::uint32_t send(abi::ControlCommand command, std::uint32_t chain = cli::kNoChain) const {
        const auto word = cli::send_command(stem_, command, chain);
        REQUIRE(word);
        return *word;
    }
    /// @returns the word
    std::uint32_t reload(const std::string& path) const {
        const auto word =
            cli::send_command(stem_, abi::ControlCommand::kReload, cli::kNoChain, path);
        REQUIRE(word);
        REQUIRE(cli::wait_for_answer(stem_, *word, kLongest) == cli::Answer::kDone);
        return *word;
    }
    void steer(abi::ControlCommand command, std::uint32_t chain = cli::kNoChain) const {
        REQUIRE(cli::wait_for_answer(stem_, send(command, chain), kLongest) == cli::Answer::kDone);
    }
    std::uint64_t frames() const {
        std::uint64_t frames = 0;
        for (const cli::ChainReading& chain : page().chains) frames += chain.finished;
        return frames;
    }
    void wait_for_frames(std::uint64_t more) const {
        const std::uint64_t first = frames();
        const nanoseconds end = monotonic_now() + kLongest;
        while (frames() < first + more && monotonic_now() < end) std::this_thread::sleep_for(1ms);
        REQUIRE(frames() >= first + more);
    }
    /// Launches have been held. On a busy machine few chains meet while none is switched off.
    void wait_for_holds() const {
        const auto holds = [&] {
            std::uint64_t sum = 0;
            for (const cli::ChainReading& chain : page().chains) sum += chain.holds;
            return sum;
        };
        const nanoseconds end = monotonic_now() + 4 * kLongest;
        while (holds() == 0 && monotonic_now() < end) std::this_thread::sleep_for(1ms);
        REQUIRE(holds() > 0);
    }
    nlohmann::json stats() const {
        return nlohmann::json::parse(read_text(folder_.path() / "stats.json"));
    }
    const std::string& stem() const { return stem_; }
    std::string folder() const { return folder_.path().string(); }

  private:
    MemoryFolder folder_;
    std::optional<Running> program_;
    int input_ = -1;
    std::string stem_;
};

inline void check_results(const Outcome& outcome) {
    CHECK(outcome.exit_status == 0);
    // Warnings of late starts are right: the GPU has more to do than it can.
    CHECK(outcome.err.find("EXIT") == std::string::npos);
    const auto lines = lines_of(outcome.out);
    CHECK(lines.size() == 4);
    for (const std::string& line : lines) {
        INFO(line);
        CHECK(line.find(": right, priority 0") != std::string::npos);
    }
}

}  // namespace urgengo::testing
