// SPDX-License-Identifier: Apache-2.0
//
// The kill switch from end to end, against the simulated GPU: a program under load is switched off
// and on at random moments, while it runs, is stopped, or is killed. URGENGO_TEST_TIMES says how
// often, 100 times if it is not set.
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <random>

#include "tests/interposer/steered.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
using abi::ControlCommand;
using nlohmann::json;

namespace {

std::uint64_t sum(const json& stats, const char* key) {
    std::uint64_t total = 0;
    for (const json& chain : stats.at("chains")) total += chain.at(key).get<std::uint64_t>();
    return total;
}

/// Too short for the chains to share the GPU, so some are held; with 20 ms none has to be.
constexpr nanoseconds kTight = 5ms;

int times() {
    const char* const asked = std::getenv("URGENGO_TEST_TIMES");
    return asked ? std::atoi(asked) : 100;
}

}  // namespace

TEST_CASE("Program is switched off and on at random moments, and its results are right",
          "[interposer][control]") {
    const std::uint32_t seed = std::random_device()();
    INFO("seed " << seed);
    std::mt19937 random(seed);
    Steered program(config::Mode::kEnforce, kTight);
    std::vector<nanoseconds> took;
    const int count = times();
    for (int i = 0; i < count; ++i) {
        INFO("time " << i);
        std::this_thread::sleep_for(std::chrono::microseconds(random() % 8000));
        const bool is_stopped = random() % 4 == 0;
        const auto command = random() % 4 == 0 ? ControlCommand::kObserve : ControlCommand::kOff;
        if (is_stopped) program.stop();
        const std::uint32_t word = program.send(command);
        if (is_stopped) {
            CHECK(cli::wait_for_answer(program.stem(), word, 5s) == cli::Answer::kStopped);
            CHECK(program.page().control_seen != word);
            program.signal(SIGCONT);
        }
        const nanoseconds begin = monotonic_now();
        // Until it is told that it goes on, it may look stopped still.
        cli::Answer answer;
        do answer = cli::wait_for_answer(program.stem(), word, kLongest);
        while (answer == cli::Answer::kStopped);
        REQUIRE(answer == cli::Answer::kDone);
        took.push_back(monotonic_now() - begin);
        CHECK(program.holds_left() == 0);
        const auto now = program.page();
        CHECK(now.mode == (command == ControlCommand::kOff ? abi::StatusMode::kOff
                                                           : abi::StatusMode::kObserve));
        program.steer(ControlCommand::kOn);
        CHECK(program.page().mode == abi::StatusMode::kEnforce);
    }
    program.wait_for_holds();
    std::sort(took.begin(), took.end());
    WARN("answers: median " << took[took.size() / 2].count() / 1000 << " us, most "
                            << took.back().count() / 1000 << " us");
    CHECK(took[took.size() / 2] < 10ms);
    check_results(program.end());
    const json stats = program.stats();
    CHECK(stats.at("tripped") == "");
    CHECK(sum(stats, "holds") > 0);
    CHECK(observe::list_pages(program.folder()).empty());
}

TEST_CASE("Program that hangs in a hold goes on at once when UrgenGo is switched off",
          "[interposer][control]") {
    const MemoryFolder folder;
    Running program({TWIN_PATH, "hangs"}, held_for_ever(folder));
    const auto held = [&] {
        const auto pages = cli::find_pages(folder.path().string());
        return pages.size() == 1 && pages[0].held_now == 1;
    };
    const nanoseconds end = monotonic_now() + kLongest;
    while (!held() && monotonic_now() < end) std::this_thread::sleep_for(1ms);
    for (int i = 0; i < 20; ++i, std::this_thread::sleep_for(5ms)) REQUIRE(held());
    const auto pages = cli::find_pages(folder.path().string());
    REQUIRE(pages.size() == 1);
    CHECK(pages[0].tasks[1].behind == 0);
    CHECK(pages[0].tasks[1].why == abi::Why::kRank);

    REQUIRE(cli::send_command(pages[0].stem, ControlCommand::kOff));
    const nanoseconds begin = monotonic_now();
    const Outcome outcome = program.wait();
    CHECK(monotonic_now() - begin < kLongest);
    CHECK(outcome.exit_status == 0);
    CHECK(outcome.out == "launched\n");
    // By _exit(): nothing of ours runs then.
    CHECK(observe::list_pages(folder.path().string()).size() == 1);
    CHECK(cli::find_pages(folder.path().string()).empty());
}

TEST_CASE("Program in which UrgenGo cannot start is not found, and does as without it",
          "[interposer][control]") {
    const MemoryFolder folder;
    const std::vector<std::string> program{TWIN_PATH, "without_thread_keys"};
    const Outcome outcome = run(program, held_for_ever(folder));
    CHECK(outcome.exit_status == 0);
    CHECK(outcome.out == run(program, bare()).out);
    CHECK(observe::list_pages(folder.path().string()).empty());
}

TEST_CASE("Nothing is held, marked or counted while UrgenGo is off", "[interposer][control]") {
    const Steered program;
    program.steer(ControlCommand::kOff);
    // Frames that have been told of before come to their end.
    std::this_thread::sleep_for(50ms);
    const auto before = program.page();
    CHECK(before.held_now == 0);
    std::this_thread::sleep_for(100ms);
    const auto after = program.page();
    for (std::size_t i = 0; i < before.chains.size(); ++i) {
        CHECK(after.chains[i].instances == before.chains[i].instances);
        CHECK(after.chains[i].finished == before.chains[i].finished);
        CHECK(after.chains[i].launches == before.chains[i].launches);
        CHECK(after.chains[i].at == -1);
    }
    program.steer(ControlCommand::kOn);
    program.wait_for_frames(20);
}

TEST_CASE("Frames are counted and nothing is held while UrgenGo observes",
          "[interposer][control]") {
    const Steered program;
    program.steer(ControlCommand::kObserve);
    program.wait_for_frames(20);
    const auto before = program.page();
    program.wait_for_frames(100);
    const auto after = program.page();
    for (std::size_t i = 0; i < before.chains.size(); ++i) {
        CHECK(after.chains[i].instances > before.chains[i].instances);
        CHECK(after.chains[i].launches > before.chains[i].launches);
        CHECK(after.chains[i].holds == before.chains[i].holds);
        CHECK(after.chains[i].held == before.chains[i].held);
    }
}

TEST_CASE("One chain is switched off and on while the others are scheduled",
          "[interposer][control]") {
    Steered program;
    const auto [command, mode] =
        GENERATE(std::pair{ControlCommand::kChainOff, abi::StatusMode::kOff},
                 std::pair{ControlCommand::kChainObserve, abi::StatusMode::kObserve},
                 std::pair{ControlCommand::kChainShadow, abi::StatusMode::kShadow});
    std::vector<nanoseconds> took;
    for (int i = 0; i < 20; ++i) {
        const nanoseconds begin = monotonic_now();
        program.steer(command, 1);
        took.push_back(monotonic_now() - begin);
        CHECK(program.holds_left() == 0);
        program.steer(ControlCommand::kChainOn, 1);
        program.wait_for_frames(3);
    }
    std::sort(took.begin(), took.end());
    CHECK(took[took.size() / 2] < 10ms);
    program.steer(command, 1);
    std::this_thread::sleep_for(100ms);  // frames that have begun come to their end
    const auto before = program.page();
    program.wait_for_frames(100);
    const auto after = program.page();
    CHECK(after.mode == abi::StatusMode::kEnforce);
    CHECK(after.chains[0].mode == abi::StatusMode::kEnforce);
    const bool is_off = command == ControlCommand::kChainOff;
    CHECK(after.chains[1].mode == mode);
    CHECK(after.chains[1].holds == before.chains[1].holds);
    CHECK((after.chains[1].launches == before.chains[1].launches) == is_off);
    const bool is_decided = command == ControlCommand::kChainShadow;
    for (std::size_t i = 0; i < after.chains.size(); ++i)
        CHECK((after.chains[i].scheduled > before.chains[i].scheduled) == (i != 1 || is_decided));
    program.steer(ControlCommand::kChainOn, 1);
    program.wait_for_frames(20);
    check_results(program.end());
}

TEST_CASE("Chain that there is not is refused and counted", "[interposer][control]") {
    const Steered program;
    const std::uint32_t word = program.send(ControlCommand::kChainOff, 4);
    REQUIRE(cli::wait_for_answer(program.stem(), word, kLongest) == cli::Answer::kDone);
    const auto page = program.page();
    CHECK(page.control_refused == 1);
    CHECK(cli::refusal(page, word) == "refused: it has no such chain");
    for (const cli::ChainReading& chain : page.chains)
        CHECK(chain.mode == abi::StatusMode::kEnforce);
}

TEST_CASE("No word of many that come at once is left out", "[interposer][control]") {
    const Steered program;
    program.stop();
    std::uint32_t word = 0;
    for (std::uint32_t i = 0; i < 4; ++i) word = program.send(ControlCommand::kChainObserve, i);
    program.send(ControlCommand::kObserve);
    word = program.send(ControlCommand::kChainOn, 2);
    program.signal(SIGCONT);
    cli::Answer answer;
    do answer = cli::wait_for_answer(program.stem(), word, kLongest);
    while (answer == cli::Answer::kStopped);
    REQUIRE(answer == cli::Answer::kDone);
    const auto page = program.page();
    CHECK(page.mode == abi::StatusMode::kObserve);
    for (std::size_t i = 0; i < 4; ++i)
        CHECK(page.chains[i].mode ==
              (i == 2 ? abi::StatusMode::kEnforce : abi::StatusMode::kObserve));
}

TEST_CASE("Launches are decided about and none is held in the shadow mode",
          "[interposer][control]") {
    const bool is_configured = GENERATE(false, true);
    Steered program(is_configured ? config::Mode::kShadow : config::Mode::kEnforce);
    if (!is_configured) program.steer(ControlCommand::kShadow);
    CHECK(program.page().mode == abi::StatusMode::kShadow);
    program.wait_for_frames(20);
    const auto before = program.page();
    program.wait_for_frames(200);
    const auto after = program.page();
    for (std::size_t i = 0; i < before.chains.size(); ++i) {
        CHECK(after.chains[i].scheduled > before.chains[i].scheduled);
        CHECK(after.chains[i].holds == before.chains[i].holds);
        CHECK(after.chains[i].held == before.chains[i].held);
        CHECK(after.chains[i].paced == before.chains[i].paced);
        if (after.chains[i].would_hold > 0) CHECK(after.chains[i].would_behind >= 0);
    }
    check_results(program.end());
    CHECK(program.stats()["mode"] == "shadow");
}

TEST_CASE("What is switched on is what the program was started with", "[interposer][control]") {
    const Steered program(config::Mode::kObserve);
    program.steer(ControlCommand::kOff);
    CHECK(program.page().mode == abi::StatusMode::kOff);
    program.steer(ControlCommand::kOn);
    CHECK(program.page().mode == abi::StatusMode::kObserve);
}

TEST_CASE("Word that means nothing is counted and changes nothing", "[interposer][control]") {
    const Steered program;
    program.steer(ControlCommand{77});
    CHECK(program.page().control_refused == 1);
    CHECK(program.page().mode == abi::StatusMode::kEnforce);
    program.steer(ControlCommand::kOff);
    CHECK(program.page().mode == abi::StatusMode::kOff);
}

TEST_CASE("Page of a killed program is not found, and goes", "[interposer][control]") {
    Steered program;
    // One that runs may have answered before the signal comes.
    const bool is_asked_before = GENERATE(false, true);
    std::uint32_t word = 0;
    if (is_asked_before) {
        program.stop();
        word = program.send(ControlCommand::kOff);
    }
    program.signal(SIGKILL);
    CHECK(program.end().exit_status == 128 + SIGKILL);
    if (!is_asked_before) word = program.send(ControlCommand::kOff);
    CHECK(cli::wait_for_answer(program.stem(), word, 5s) == cli::Answer::kGone);
    CHECK(observe::list_pages(program.folder()).size() == 1);
    CHECK(cli::find_pages(program.folder()).empty());
    CHECK(observe::list_pages(program.folder()).empty());
}

TEST_CASE("urgengo ctl steers, tells what it has done, and says what is wrong",
          "[interposer][control]") {
    Steered program;
    Environment environment{{"PATH", "/usr/bin:/bin"}, {"URGENGO_SHARE", program.folder()}};
    const auto ctl = [&](std::vector<std::string> arguments) {
        arguments.insert(arguments.begin(), {URGENGO_PATH, "ctl"});
        return run(arguments, environment);
    };
    const std::string pid = std::to_string(program.page().process.process);
    for (const std::vector<std::string>& which :
         {std::vector<std::string>{}, {"--all"}, {"--pid", pid}}) {
        for (const auto& [word, mode] : {std::pair{"off", abi::StatusMode::kOff},
                                         std::pair{"observe", abi::StatusMode::kObserve},
                                         std::pair{"shadow", abi::StatusMode::kShadow},
                                         std::pair{"on", abi::StatusMode::kEnforce}}) {
            std::vector<std::string> arguments{word, "--json"};
            arguments.insert(arguments.end(), which.begin(), which.end());
            const Outcome outcome = ctl(arguments);
            CHECK(outcome.err == "");
            REQUIRE(outcome.exit_status == 0);
            const json process = json::parse(outcome.out).at("processes").at(0);
            CHECK(process.at("pid") == program.page().process.process);
            CHECK(process.at("program") == "twin");
            CHECK(process.at("result") == "done");
            CHECK(program.page().mode == mode);
        }
    }
    const Outcome status = ctl({"status"});
    CHECK(status.exit_status == 0);
    CHECK(status.out.find(pid) != std::string::npos);
    CHECK(status.out.find("enforce") != std::string::npos);
    CHECK(ctl({"off", "--quiet"}).out == "");
    CHECK(ctl({"on", "--quiet"}).out == "");
    const Outcome one = ctl({"observe", "--chain", "steered_2"});
    CHECK(one.exit_status == 0);
    CHECK(one.out.find("enforce; steered_2 observe") != std::string::npos);
    CHECK(program.page().chains[2].mode == abi::StatusMode::kObserve);
    CHECK(ctl({"shadow", "--chain", "steered_1"}).exit_status == 0);
    CHECK(program.page().chains[1].mode == abi::StatusMode::kShadow);
    CHECK(ctl({"on", "--chain", "steered_1"}).exit_status == 0);
    const json shown = json::parse(ctl({"status", "--json"}).out).at("processes").at(0);
    CHECK(shown.at("mode") == "enforce");
    CHECK(shown.at("chains").at(2).at("mode") == "observe");
    CHECK(ctl({"on", "--chain", "steered_2"}).out.find("steered_2") == std::string::npos);
    const Outcome unknown = ctl({"off", "--chain", "nobody"});
    CHECK(unknown.exit_status == 1);
    CHECK(unknown.err.find("has no chain 'nobody', only steered_0, steered_1") !=
          std::string::npos);

    program.stop();
    const Outcome stopped = ctl({"on"});
    CHECK(stopped.exit_status == 0);
    CHECK(stopped.out.find("stopped: acts when it is continued") != std::string::npos);
    program.signal(SIGCONT);

    CHECK(ctl({"off", "--pid", "1"}).err.find("found no process 1 under UrgenGo") !=
          std::string::npos);
    CHECK(ctl({"dance"}).exit_status == 2);
    check_results(program.end());
    CHECK(ctl({"off"}).exit_status == 1);
    CHECK(ctl({"off"}).err.find("found no process under UrgenGo") != std::string::npos);
    const Outcome none = ctl({"status"});
    CHECK(none.exit_status == 0);
    CHECK(none.out == "no process under UrgenGo\n");
}
