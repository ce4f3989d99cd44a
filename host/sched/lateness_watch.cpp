// SPDX-License-Identifier: Apache-2.0
#include "host/sched/lateness_watch.h"

#include <algorithm>
#include <cmath>

namespace urgengo::sched {
namespace {

using namespace std::chrono_literals;

constexpr nanoseconds kStartUp = 1s;
constexpr int kStartUpFrames = 5;

constexpr nanoseconds kShortestWindow = 500ms;
constexpr int kPeriodsOfWindow = 4;

constexpr nanoseconds kLateOf = 10s;
/// What a comparison costs, in earned time; and where lateness is so great lately, less.
constexpr nanoseconds kPrice = 500ms, kPriceOfMuch = 250ms;
constexpr double kContradicted = 0.25;
/// What was earned so long ago counts for a third.
constexpr double kForgets_s = 60;
/// A single chain's lateness counts for so much less than all chains'.
constexpr double kOneOfThree = 3;

/// The moving mean of a chain's lateness is over this time.
constexpr double kLevelOver_s = 3;

double seconds(nanoseconds time) {
    return 1e-9 * static_cast<double>(time.count());
}

}  // namespace

LatenessWatch::LatenessWatch(const std::vector<nanoseconds>& periods) : watches_(periods.size()) {
    for (std::size_t i = 0; i < periods.size(); ++i) watches_[i].period = periods[i];
}

void LatenessWatch::frame_ended(std::size_t chain, double ratio, nanoseconds now) {
    if (!start_) start_ = now;
    Watch& its = watches_[chain];
    const double lateness = lateness_of(ratio);
    const double since_s = seconds(std::min(now - its.last_end, kLongestWindow));
    its.level += std::clamp(since_s / kLevelOver_s, 0.02, 0.5) * (lateness - its.level);
    const bool starts_up = ++its.frames <= kStartUpFrames || is_starting_up(now);
    its.earned_s *= std::exp(-seconds(now - its.last_end) / kForgets_s);
    its.last_end = now;
    if (ratio <= 1 || starts_up) return;
    last_late_ = now;
    its.earned_s += lateness * seconds(std::min(its.period, kLongestWindow));
}

void LatenessWatch::spend() {
    for (Watch& w : watches_) w.earned_s = 0;
}

nanoseconds LatenessWatch::running(nanoseconds now) const {
    return start_ ? now - *start_ : nanoseconds{0};
}

bool LatenessWatch::is_starting_up(nanoseconds now) const {
    return running(now) < kStartUp;
}

double LatenessWatch::level() const {
    double sum = 0;
    std::size_t n = 0;
    for (const Watch& w : watches_)
        if (w.frames > 0) sum += w.level, ++n;
    return n ? sum / static_cast<double>(n) : 0;
}

double LatenessWatch::earned_s(nanoseconds now) const {
    double sum = 0, most = 0;
    std::size_t n = 0;
    for (const Watch& w : watches_) {
        if (w.frames == 0) continue;
        const double earned = w.earned_s * std::exp(-seconds(now - w.last_end) / kForgets_s);
        sum += earned;
        most = std::max(most, earned);
        ++n;
    }
    return n ? std::max(sum / static_cast<double>(n), most / kOneOfThree) : 0;
}

nanoseconds LatenessWatch::window() const {
    std::vector<nanoseconds> periods;
    for (const Watch& w : watches_)
        if (w.frames > 0) periods.push_back(w.period);
    if (periods.empty()) return kShortestWindow;
    const auto median = periods.begin() + static_cast<std::ptrdiff_t>(periods.size() / 2);
    std::nth_element(periods.begin(), median, periods.end());
    return std::clamp(kPeriodsOfWindow * *median, kShortestWindow, kLongestWindow);
}

bool LatenessWatch::pays_for_comparison(nanoseconds now) const {
    if (last_late_.count() == 0 || now - last_late_ > kLateOf) return false;
    const bool contradicted = std::ranges::any_of(watches_, &Watch::contradicts);
    const bool is_much = level() >= kMuch;
    const double price_s = seconds(is_much ? kPriceOfMuch : std::max(kPrice, window())) *
                           (contradicted ? kContradicted : 1);
    return earned_s(now) >= price_s;
}

}  // namespace urgengo::sched
