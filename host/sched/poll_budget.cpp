// SPDX-License-Identifier: Apache-2.0
#include "host/sched/poll_budget.h"

#include <algorithm>

namespace urgengo::sched {
namespace {

/// Intervals grow by so much in a window at most, and shrink by kShrink where less than kEnough of
/// the budget is used.
constexpr double kGrow = 4, kShrink = 0.8, kEnough = 0.7;
/// A window that is so many times too long was one without looks.
constexpr int kIdleWindows = 5;

}  // namespace

void PollBudget::looked(nanoseconds begin, nanoseconds end) {
    spent_ns_.fetch_add((end - begin + kWakeUp).count(), kRelaxed);
    std::int64_t window = window_ns_.load(kRelaxed);
    const nanoseconds age = end - nanoseconds(window);
    // The thread that moves the window on adapts; the next one does a whole window later.
    if (age < kWindow || !window_ns_.compare_exchange_strong(window, end.count())) return;
    const std::int64_t spent = spent_ns_.exchange(0, kRelaxed);
    total_ns_.fetch_add(spent, kRelaxed);
    if (window == 0 || age > kIdleWindows * kWindow) {
        stretch_.store(1, kRelaxed);
        windows_over_ = 0;
        return;
    }
    adapt(static_cast<double>(spent) / static_cast<double>(age.count()), end);
}

void PollBudget::adapt(double share, nanoseconds now) {
    const double stretch = stretch_.load(kRelaxed);
    if (share <= kShare) {
        windows_over_ = 0;
        if (share < kEnough * kShare) stretch_.store(std::max(1.0, kShrink * stretch), kRelaxed);
        return;
    }
    stretch_.store(std::min(stretch * std::min(share / kShare, kGrow), kMostStretch), kRelaxed);
    windows_over_ = stretch < kMostStretch ? 0 : windows_over_ + 1;
    if (windows_over_ < kWindowsOver) return;
    windows_over_ = 0;
    over_until_ns_.store((now + kRest).count(), kRelaxed);
    num_ends_.fetch_add(1, kRelaxed);
}

nanoseconds PollBudget::rest(int place, nanoseconds most) const {
    const double stretch = stretch_.load(kRelaxed);
    const double times =
        place < kFirsts ? std::min(stretch, kMostStretchOfFirsts) : (place - 1) * stretch;
    const auto rest = nanoseconds(static_cast<std::int64_t>(std::min(
        times * static_cast<double>(poll_.count()), static_cast<double>(kLongest.count()))));
    // A poll that the config makes longer than that is its own wish.
    return std::min(std::max(rest, poll_), std::max(most, nanoseconds{1'000}));
}

}  // namespace urgengo::sched
