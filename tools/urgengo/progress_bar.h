// SPDX-License-Identifier: Apache-2.0
//
// How far a long command is, on stderr, where that is a terminal.
#pragma once

#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <string>

namespace urgengo::cli {

/// A bar on a terminal, once it is worth one.
class ProgressBar {
  public:
    explicit ProgressBar(bool is_wanted) : is_wanted_(is_wanted && isatty(STDERR_FILENO) != 0) {}
    ~ProgressBar() {
        if (shown_ >= 0) fmt::print(stderr, "\r{:{}}\r", "", kWidth + 50);
    }
    ProgressBar(const ProgressBar&) = delete;
    ProgressBar& operator=(const ProgressBar&) = delete;

    /// @param part  of everything, 0 to 1
    void show(double part, const std::string& what) {
        const int pct = static_cast<int>(100 * part);
        if (!is_wanted_ || pct == shown_ || Clock::now() - begin_ < kPatience) return;
        shown_ = pct;
        const int done = pct * kWidth / 100;
        fmt::print(stderr, "\r[{:#<{}}{:.<{}}] {:3} % {:<40}", "", done, "", kWidth - done, pct,
                   what);
        std::fflush(stderr);
    }

  private:
    using Clock = std::chrono::steady_clock;
    static constexpr int kWidth = 30;
    static constexpr std::chrono::seconds kPatience{2};

    const bool is_wanted_;
    const Clock::time_point begin_ = Clock::now();
    int shown_ = -1;
};

}  // namespace urgengo::cli
