// SPDX-License-Identifier: Apache-2.0
#include "host/base/own_log.h"

#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <thread>

#include "tests/support/catch.h"
#include "tests/support/folder.h"

using namespace urgengo;
using testing::Folder;

namespace {

/// A log that is never destroyed, as the process' own.
OwnLog& new_log() {
    static auto* const logs = new std::vector<OwnLog*>;  // so none is taken for a leak
    return *logs->emplace_back(new OwnLog);
}

std::vector<std::string> lines_of_file(const std::string& path) {
    std::ifstream file(path);
    std::vector<std::string> lines;
    for (std::string line; std::getline(file, line);) lines.push_back(line);
    return lines;
}

}  // namespace

TEST_CASE("Own log has each line with its time, detail and thread", "[unit][log]") {
    const Folder folder;
    const std::string path = folder.path("own.log");
    OwnLog& log = new_log();
    CHECK_FALSE(log.tells(LogDetail::kInfo));
    log.note(LogDetail::kInfo, "before it starts");
    const bool is_debug = GENERATE(false, true);
    REQUIRE(log.start(is_debug ? LogDetail::kDebug : LogDetail::kInfo, path) == "");
    log.note(LogDetail::kInfo, "first");
    log.note(LogDetail::kDebug, "second\n\x1b[2J");
    log.note(LogDetail::kInfo, std::string(300, 'x'));
    log.finish();
    log.note(LogDetail::kInfo, "after its end");
    const auto lines = lines_of_file(path);
    REQUIRE(lines.size() == (is_debug ? 3u : 2u));
    const std::string head = "\\d{4}-\\d\\d-\\d\\dT\\d\\d:\\d\\d:\\d\\d\\.\\d{6}Z ";
    const std::string thread = " " + std::to_string(gettid()) + " ";
    CHECK(std::regex_match(lines[0], std::regex(head + "info" + thread + "first")));
    if (is_debug)
        CHECK(
            std::regex_match(lines[1], std::regex(head + "debug" + thread + "second\\?\\?\\[2J")));
    CHECK(lines.back().substr(lines.back().rfind(' ') + 1) == std::string(OwnLog::kMostText, 'x'));
}

TEST_CASE("Own log keeps lines of threads whole and in order, and counts those without room",
          "[unit][log]") {
    constexpr int kThreads = 4, kLines = 3000;
    const Folder folder;
    const std::string path = folder.path("own.log");
    OwnLog& log = new_log();
    REQUIRE(log.start(LogDetail::kInfo, path) == "");
    std::vector<std::thread> threads;
    for (int t = 0; t < kThreads; ++t)
        threads.emplace_back([&log, t] {
            for (int i = 0; i < kLines; ++i)
                log.note(LogDetail::kInfo, fmt::format("thread {} line {}", t, i));
        });
    for (std::thread& thread : threads) thread.join();
    log.finish();
    std::map<int, int> last;
    std::uint64_t told = 0, dropped = 0;
    for (const std::string& line : lines_of_file(path)) {
        std::smatch match;
        if (std::regex_match(line, match, std::regex("\\((\\d+) lines were dropped\\)"))) {
            dropped += std::stoull(match[1]);
            continue;
        }
        REQUIRE(std::regex_match(line, match, std::regex(".* info \\d+ thread (\\d) line (\\d+)")));
        const int thread = std::stoi(match[1]), number = std::stoi(match[2]);
        CHECK((last.count(thread) == 0 || number > last[thread]));
        last[thread] = number;
        ++told;
    }
    CHECK(told >= OwnLog::kLines);
    CHECK(dropped > 0);
    CHECK(dropped == log.dropped());
    CHECK(told + dropped == kThreads * kLines);
}

TEST_CASE("Own log says why it cannot be written, and tells nothing then", "[unit][log]") {
    const Folder folder;
    REQUIRE(mkfifo(folder.path("fifo").c_str(), 0600) == 0);
    std::filesystem::create_symlink(folder.path("target"), folder.path("link"));
    for (const std::string name : {"none/own.log", "fifo", "link", ""}) {
        OwnLog& log = new_log();
        const std::string error = log.start(LogDetail::kDebug, folder.path(name));
        CHECK(error.rfind(folder.path(name) + ": cannot be written: ", 0) == 0);
        CHECK_FALSE(log.tells(LogDetail::kInfo));
        log.note(LogDetail::kInfo, "nothing");
        log.finish();
    }
    CHECK_FALSE(std::filesystem::exists(folder.path("target")));
}

TEST_CASE("Own log is written where the program was, and goes on when its file is removed",
          "[unit][log]") {
    const Folder folder;
    const auto before = std::filesystem::current_path();
    std::filesystem::current_path(folder.path());
    OwnLog& log = new_log();
    const std::string error = log.start(LogDetail::kInfo, "own.log");
    std::filesystem::current_path(before);
    REQUIRE(error == "");
    log.note(LogDetail::kInfo, "first");
    log.finish();
    CHECK(lines_of_file(folder.path("own.log")).size() == 1);
    std::filesystem::remove(folder.path("own.log"));
    OwnLog& removed = new_log();
    REQUIRE(removed.start(LogDetail::kInfo, folder.path("own.log")) == "");
    std::filesystem::remove(folder.path("own.log"));
    removed.note(LogDetail::kInfo, "lost");
    removed.finish();
    CHECK_FALSE(std::filesystem::exists(folder.path("own.log")));
}
