// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/progress_bar.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>

#include "tools/log/log.h"

namespace urgengo::cli {
namespace {

constexpr int kWidth = 30;
constexpr std::size_t kLongest = 79;  // a longer line would wrap, and could not be erased
constexpr std::chrono::seconds kPatience{2};

ProgressBar* g_the_one = nullptr;

}  // namespace

std::string progress_text(double part, const std::string& what, std::chrono::seconds elapsed) {
    std::string text;
    if (part >= 0) {
        const int pct = static_cast<int>(100 * std::min(part, 1.0));
        const int done = pct * kWidth / 100;
        text = fmt::format("[{:#<{}}{:.<{}}] {:3} % ", "", done, "", kWidth - done, pct);
    }
    const std::string time = fmt::format(", {} s", elapsed.count());
    return text + what.substr(0, kLongest - text.size() - time.size()) + time;
}

ProgressBar::ProgressBar() : ProgressBar(tools::says(tools::LogLevel::kInfo)) {}

ProgressBar::ProgressBar(bool is_wanted)
    : is_wanted_(is_wanted && isatty(STDERR_FILENO) != 0), before_(g_the_one) {
    g_the_one = this;
    tools::set_before_line(erase_the_one);
}

ProgressBar::~ProgressBar() {
    erase();
    g_the_one = before_;
    if (!before_) tools::set_before_line(nullptr);
}

void ProgressBar::show(double part, const std::string& what) {
    part_ = part;
    what_ = what;
    draw();
}

void ProgressBar::tick() {
    if (g_the_one) g_the_one->draw();
}

void ProgressBar::draw() {
    const auto elapsed = Clock::now() - begin_;
    if (!is_wanted_ || what_.empty() || elapsed < kPatience) return;
    std::string text =
        progress_text(part_, what_, std::chrono::duration_cast<std::chrono::seconds>(elapsed));
    if (text == drawn_) return;
    fmt::print(stderr, "\r{:<{}}", text, drawn_.size());
    std::fflush(stderr);
    drawn_ = std::move(text);
}

void ProgressBar::erase() {
    if (drawn_.empty()) return;
    fmt::print(stderr, "\r{:{}}\r", "", drawn_.size());
    std::fflush(stderr);
    drawn_.clear();
}

void ProgressBar::erase_the_one() {
    if (g_the_one) g_the_one->erase();
}

}  // namespace urgengo::cli
