// SPDX-License-Identifier: Apache-2.0
//
// How far a long command is, on stderr, where that is a terminal. Of one whose length is not known:
// how long it has taken. Shown once it has taken two seconds, and gone when the object goes. A line
// that is logged meanwhile (tools/log/log.h) takes its place.
//
// @threads main only
#pragma once

#include <chrono>
#include <cstddef>
#include <string>

namespace urgengo::cli {

class ProgressBar {
  public:
    /// On a terminal, unless --quiet was given.
    ProgressBar();
    /// @param is_wanted  on a terminal
    explicit ProgressBar(bool is_wanted);
    ~ProgressBar();
    ProgressBar(const ProgressBar&) = delete;
    ProgressBar& operator=(const ProgressBar&) = delete;

    /// @param part  of everything, 0 to 1; below 0: not known
    void show(double part, const std::string& what);
    /// The same of steps: before number `done` of them, from 0.
    void show_step(std::size_t done, std::size_t steps, const std::string& what) {
        show(steps == 0 ? -1 : static_cast<double>(done) / static_cast<double>(steps), what);
    }

    /// Time has passed: of the one that lives, if one does. What waits for long calls it often.
    static void tick();

  private:
    using Clock = std::chrono::steady_clock;

    void draw();
    void erase();
    static void erase_the_one();

    const bool is_wanted_;
    ProgressBar* const before_;
    const Clock::time_point begin_ = Clock::now();
    double part_ = -1;
    std::string what_, drawn_;
};

/// @param part  as ProgressBar::show()
/// @returns "[######........................]  20 % what, 12 s", or "what, 12 s"; 79 characters at
///          most
std::string progress_text(double part, const std::string& what, std::chrono::seconds elapsed);

}  // namespace urgengo::cli
