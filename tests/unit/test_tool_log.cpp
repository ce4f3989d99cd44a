// SPDX-License-Identifier: Apache-2.0
//
// What the command-line tools say on stderr (tools/log/log.h).
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/catch.h"
#include "tools/log/log.h"

namespace urgengo::tools {
namespace {

/// Stderr is a file for as long as the object lives; the log's name is the default one afterwards.
class Stderr {
  public:
    Stderr() : file_(std::tmpfile()), before_(dup(STDERR_FILENO)) {
        REQUIRE(file_ != nullptr);
        REQUIRE(dup2(fileno(file_), STDERR_FILENO) == STDERR_FILENO);
    }
    ~Stderr() {
        dup2(before_, STDERR_FILENO);
        close(before_);
        std::fclose(file_);
        set_log_name("urgengo");
    }
    Stderr(const Stderr&) = delete;
    Stderr& operator=(const Stderr&) = delete;

    /// What was written by now; nothing is kept back.
    std::string text() const {
        std::string text(1 << 20, '\0');
        text.resize(static_cast<std::size_t>(
            std::max<ssize_t>(0, pread(fileno(file_), text.data(), text.size(), 0))));
        return text;
    }

  private:
    std::FILE* file_;
    int before_;
};

TEST_CASE("Tool's log says no line below its level", "[unit][log]") {
    const Stderr captured;
    const auto say_all = [] {
        log_debug("d");
        log_info("i");
        log_warning("w");
        log_error("e");
    };
    say_all();
    set_log_level(LogLevel::kError);
    say_all();
    set_log_level(LogLevel::kDebug);
    set_log_name("other");
    log_debug("d");
    set_log_level(LogLevel::kInfo);
    CHECK(captured.text() == "urgengo: i\nurgengo: warning: w\nurgengo: e\nurgengo: e\nother: d\n");
}

TEST_CASE("A tool's lines begin with its name, and a warning says that it is one", "[unit][cli]") {
    std::string text;
    {
        const Stderr captured;
        log_info("wrote {} of {}", 1, "two");
        log_warning("late");
        log_error("100 % {{}}");
        set_log_name("urgengo-chains");
        log_info("{}", "");
        log_warning("{}", "again");
        text = captured.text();
    }
    CHECK(text ==
          "urgengo: wrote 1 of two\n"
          "urgengo: warning: late\n"
          "urgengo: 100 % {}\n"
          "urgengo-chains: \n"
          "urgengo-chains: warning: again\n");
}

TEST_CASE("Lines of several threads stay whole", "[unit][cli]") {
    constexpr int kThreads = 4, kLines = 200;
    const std::string words(300, 'x');
    std::string text;
    {
        const Stderr captured;
        std::vector<std::thread> threads;
        for (int t = 0; t < kThreads; ++t)
            threads.emplace_back([&] {
                for (int i = 0; i < kLines; ++i) log_info("{}", words);
            });
        for (std::thread& thread : threads) thread.join();
        text = captured.text();
    }
    std::string expected;
    for (int i = 0; i < kThreads * kLines; ++i) expected += "urgengo: " + words + "\n";
    CHECK(text.size() == expected.size());
    CHECK(text == expected);
}

}  // namespace
}  // namespace urgengo::tools
