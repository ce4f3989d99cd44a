// SPDX-License-Identifier: Apache-2.0
#include "host/model/estimate_factor.h"

namespace urgengo::model {
namespace {

/// Halfway to what was measured alone, but not more than so many times as long at once.
constexpr double kGain = 0.5;
constexpr double kMostGrowth = 2;
/// And so much of the way back to the plan where nothing else is known.
constexpr double kBack = 1.0 / 64;

double ratio(nanoseconds measured, nanoseconds estimated) {
    return static_cast<double>(measured.count()) / static_cast<double>(estimated.count());
}

}  // namespace

void EstimateFactor::observe(const Instance& instance) {
    observe(instance, kMost);
}

void EstimateFactor::observe(const Instance& instance, double most) {
    if (instance.estimated.count() <= 0 || instance.most.count() <= 0) return;
    upper_[num_upper_ % kRecent] = ratio(instance.most, instance.estimated);
    ++num_upper_;
    double wanted = factor_ < 1 ? factor_ + kBack * (1 - factor_) : factor_;
    if (instance.alone) {
        lower_[num_alone_ % kAlone] =
            ratio(std::min(instance.least, instance.most), instance.estimated);
        ++num_alone_;
        const double least = *std::min_element(lower_.begin(), lower_.end());
        if (num_alone_ >= kAlone && least > factor_)
            wanted = std::min(factor_ + kGain * (least - factor_), kMostGrowth * factor_);
    }
    if (num_upper_ >= kRecent)
        wanted = std::min(wanted, *std::max_element(upper_.begin(), upper_.end()));
    factor_ = std::clamp(wanted, kLeast, most);
}

void EstimateFactor::observe_unknown(const Instance& instance) {
    if (instance.estimated.count() <= 0 || instance.most.count() <= 0) return;
    if (2 * instance.waited < instance.most) return observe(instance, kMostUnknown);
    unknown_[num_unknown_ % kUnknown] = ratio(instance.most, instance.estimated);
    ++num_unknown_;
    if (num_unknown_ < kRecent) return;
    const auto end = unknown_.begin() + std::min<std::ptrdiff_t>(num_unknown_, kUnknown);
    factor_ = std::clamp(*std::min_element(unknown_.begin(), end), kLeast, kMostUnknown);
}

}  // namespace urgengo::model
