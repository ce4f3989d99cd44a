// SPDX-License-Identifier: Apache-2.0
#include "host/sched/comparison.h"

#include <array>
#include <cmath>

namespace urgengo::sched {
namespace {

/// Differences that happen to be equal do not prove themselves.
constexpr double kLeastSpread = 0.01;
/// Of Student's t, one-sided at 0.5 %, by degrees of freedom from 2 on; the last one for all more.
constexpr std::array kT = {9.925, 5.841, 4.604, 4.032, 3.707, 3.499, 3.355, 3.250};
/// Of Student's t, two-sided at 5 %, by degrees of freedom from 1 on; the last one for all more.
constexpr std::array kT95 = {12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262};
constexpr std::size_t kFewestPairs = 3;
/// Differences that need no more than two pairs.
constexpr double kObvious = 0.35;
/// A difference of the first pair that is enough not to schedule less.
constexpr double kPlainlyWorse = 0.1;

/// Frames of a chain that a mean is taken of, at least.
constexpr std::size_t kFew = 3;
constexpr std::size_t kMostPairs = 10;
/// From so many pairs on, what has shown half of an effect that is worth it, or less, is given up.
constexpr std::size_t kEnoughPairs = 4;
/// Chains with few frames give no difference at most pairs.
constexpr int kMostWindows = 40;
/// Late frames more than usual that end a window: of several chains, or of one.
constexpr double kMuchLater = 2, kMuchLaterOne = 5;
/// A chain that has ended so many frames since a switch, all from before, has fallen behind.
constexpr int kBehind = 2;
/// By so much a chain's mean is later than usual, to be one of several.
constexpr double kHit = 0.3;

/// Frames that take many deadlines are few in a window: so each counts for as many.
double late_time_of(double ratio) {
    return lateness_of(ratio) * std::max(1.0, ratio);
}

}  // namespace

void Series::add(double x) {
    greatest_ = n_ == 0 ? x : std::max(greatest_, x);
    ++n_;
    const double off = x - mean_;
    mean_ += off / static_cast<double>(n_);
    squares_ += off * (x - mean_);
}

double Series::error() const {
    const auto n = static_cast<double>(n_);
    return std::sqrt((squares_ / (n - 1) + kLeastSpread * kLeastSpread) / n);
}

double Series::t() const {
    return n_ < 2 ? 0 : mean_ / error();
}

double Series::margin() const {
    return n_ < 2 ? 0 : kT95[std::min(n_ - 2, kT95.size() - 1)] * error();
}

bool Series::is_above_zero() const {
    return n_ >= kFewestPairs && t() >= kT[std::min(n_ - kFewestPairs, kT.size() - 1)];
}

bool Series::is_below_zero() const {
    return n_ >= kFewestPairs && -t() >= kT[std::min(n_ - kFewestPairs, kT.size() - 1)];
}

Comparison::Comparison(std::size_t num_chains, int subject, nanoseconds window, nanoseconds now,
                       bool other_is_less, double worst)
    : window_(window),
      subject_(subject),
      other_is_less_(other_is_less),
      chains_(num_chains),
      worst_(worst),
      window_start_(now) {}

void Comparison::frame_began(std::size_t chain, nanoseconds arrival, nanoseconds deadline) {
    Chain& c = chains_[chain];
    if (c.open.count() >= 0) return;
    c.open = std::max(arrival, c.last_end);
    c.deadline = deadline;
}

Verdict Comparison::frame_ended(std::size_t chain, nanoseconds arrival, nanoseconds deadline,
                                nanoseconds now) {
    Chain& c = chains_[chain];
    c.open = nanoseconds{-1};
    const bool is_new = arrival >= way_start_;
    const nanoseconds from = is_new ? arrival : std::max(way_start_, c.last_end);
    if (is_new ? c.may_count : c.ended >= kBehind) {
        const double ratio = ratio_of(now - from, deadline);
        c.window.add(lateness_of(ratio));
        late_ += late_time_of(ratio);
    }
    c.may_count = c.may_count || is_new;
    c.last_end = now;
    ++c.ended;
    if (other_is_on_ && is_much_later(now)) {
        end_window(now);
        return Verdict::kWorse;
    }
    if (now - window_start_ < window_) return Verdict::kOpen;
    end_window(now);
    return num_windows_ % 2 == 0 ? verdict() : Verdict::kOpen;
}

// Frames that the usual way's mean expects to be late vary by about the root of their number. One
// that is late already counts before it ends: where frames pile up hardly any ends.
bool Comparison::is_much_later(nanoseconds now) const {
    double late = 0, expected = 0, late_time = late_;
    int hit = 0;
    for (const Chain& c : chains_) {
        Series window = c.window;
        if (is_late_already(c, now)) {
            const double ratio = ratio_of(now - c.open, c.deadline);
            window.add(lateness_of(ratio));
            late_time += late_time_of(ratio);
        }
        const auto n = static_cast<double>(window.size());
        late += n * window.mean();
        expected += n * c.total[0].mean();
        hit += n > 0 && window.mean() > c.total[0].mean() + kHit;
    }
    if (late_time <= worst_) return false;
    return late - expected > (hit > 1 ? kMuchLater : kMuchLaterOne) + 2 * std::sqrt(expected);
}

bool Comparison::is_late_already(const Chain& chain, nanoseconds now) const {
    return chain.open >= way_start_ && now - chain.open > chain.deadline;
}

void Comparison::end_window(nanoseconds now) {
    const int way = other_is_on_;
    double late = 0;
    for (Chain& c : chains_) {
        if (is_late_already(c, now)) c.window.add(lateness_of(ratio_of(now - c.open, c.deadline)));
        late += static_cast<double>(c.window.size()) * c.window.mean();
        for (Series* into : {&c.pooled[way], &c.total[way]})
            for (std::size_t i = 0; i < c.window.size(); ++i) into->add(c.window.mean());
        c.window = {};
    }
    if (worst_ > 0 && !other_is_on_) worst_ = std::max(worst_, late);
    late_ = 0;
    ++num_windows_;
    window_start_ = now;
    if (num_windows_ % 2 == 0) end_pair();
    const bool other_is_next = (num_windows_ + 1) / 2 % 2 == 1;
    if (other_is_next == other_is_on_) return;
    other_is_on_ = other_is_next;
    way_start_ = now;
    for (Chain& c : chains_) {
        c.may_count = false;
        c.ended = 0;
    }
}

void Comparison::end_pair() {
    Series of_chains;
    for (Chain& c : chains_) {
        if (c.pooled[0].size() < kFew || c.pooled[1].size() < kFew) continue;
        c.differences.add(c.pooled[1].mean() - c.pooled[0].mean());
        of_chains.add(c.pooled[1].mean() - c.pooled[0].mean());
        c.pooled[0] = c.pooled[1] = {};
    }
    if (of_chains.size() > 0) differences_.add(of_chains.mean());
}

double Comparison::mean_of(int way) const {
    Series of_chains;
    for (const Chain& c : chains_)
        if (c.total[0].size() > 0 && c.total[1].size() > 0) of_chains.add(c.total[way].mean());
    return of_chains.mean();
}

double Comparison::gain_of(std::size_t chain) const {
    return usual(chain) - other(chain);
}

Finding Comparison::finding(std::size_t chain) const {
    const Series& differences = chains_[chain].differences;
    return {differences.size(), usual(chain), other(chain),
            differences.mean() - differences.margin(), differences.mean() + differences.margin()};
}

bool Comparison::gains(std::size_t chain) const {
    return gain_of(chain) >= kWorthIt && chains_[chain].differences.is_below_zero();
}

bool Comparison::loses(std::size_t chain) const {
    return gain_of(chain) <= -kWorthIt && chains_[chain].differences.is_above_zero();
}

Verdict Comparison::verdict() const {
    const double gain = usual() - other();
    const bool for_all = subject_ == kAllChains;
    const auto subject = static_cast<std::size_t>(subject_);
    const Series& series = for_all ? differences_ : chains_[subject].differences;
    const double wanted = for_all ? gain : gain_of(subject);
    if (wanted >= kWorthIt && series.is_below_zero() && gain >= 0) return Verdict::kBetter;
    if (series.size() >= 2 && series.greatest() <= -kObvious && gain >= 0) return Verdict::kBetter;
    // To stay as it is needs less proof than to change.
    if (other_is_less_ && differences_.size() == 1 && differences_.mean() >= kPlainlyWorse)
        return Verdict::kWorse;
    if (differences_.size() >= 2 && gain <= -kWorthIt && differences_.t() >= 1)
        return Verdict::kWorse;
    if (series.size() >= kEnoughPairs && gain <= -kWorthIt) return Verdict::kWorse;
    const bool is_hopeless =
        series.size() >= kEnoughPairs && (wanted < kWorthIt / 2 || gain <= -kWorthIt / 2);
    if (is_hopeless || series.size() >= kMostPairs || num_windows_ >= kMostWindows)
        return Verdict::kAlike;
    return Verdict::kOpen;
}

}  // namespace urgengo::sched
