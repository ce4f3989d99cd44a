// SPDX-License-Identifier: Apache-2.0
#include "host/model/launch_contention.h"

#include <algorithm>

namespace urgengo::model {
namespace {

constexpr double kBeside = 0.5;
/// Others that launch, in the mean.
constexpr double kAlone = 0.25;
constexpr double kLeastPace = 0.5, kMostPace = 4;
constexpr double kMedian = 0.5, kLowerQuartile = 0.25;

}  // namespace

template <std::size_t kSize>
double LaunchContention::Samples<kSize>::quantile(double share) const {
    const std::size_t n = std::min(count, kSize);
    std::array<double, kSize> sorted = values;
    std::sort(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(n));
    return sorted[static_cast<std::size_t>(static_cast<double>(n - 1) * share)];
}

void LaunchContention::held(bool in_vain, nanoseconds now) {
    in_vain_ = in_vain ? in_vain_ + 1 : 0;
    if (in_vain_ < kInVain) return;
    in_vain_ = 0;
    verdict_ = Launching::kFree;
    rests_until_ = now + retry_;
    retry_ = std::min(2 * retry_, kMostRetry);
}

void LaunchContention::observe(const Instance& instance, nanoseconds now) {
    if (now < rests_until_) return;
    if (verdict_ == Launching::kSlowed && now - found_ >= retry_) {
        verdict_ = Launching::kUnknown;
        beside_ = {};
        done_ = {};
        retry_ = std::min(2 * retry_, kMostRetry);
    }
    if (instance.alone < kLeastTime || instance.marks == 0) return;
    const double share = static_cast<double>(instance.beside) / instance.marks;
    const double ratio =
        static_cast<double>(instance.took.count()) / static_cast<double>(instance.alone.count());
    usual_.add(ratio);
    if (share >= kBeside) {
        const double times = ratio / alone_pace_;
        beside_.add(times);
        const int all = instance.marks + instance.others + instance.free;
        if (times > 0 && !instance.unknown)
            done_.add(static_cast<double>(all) / instance.marks / times);
        if (beside_.count >= kFirst) judge(now);
    } else if (!instance.unknown && instance.others + instance.free <= kAlone * instance.marks) {
        alone_.add(ratio);
        if (alone_.count >= kFirst)
            alone_pace_ = std::clamp(alone_.quantile(kLowerQuartile), kLeastPace, kMostPace);
    }
    find_pace();
}

void LaunchContention::find_pace() {
    pace_ = alone_pace_;
    if (verdict_ == Launching::kSlowed || usual_.count < kFirst) return;
    const double usual = std::clamp(usual_.quantile(kLowerQuartile), kLeastPace, kMostPace);
    if (usual >= kFreeBelow * alone_pace_) pace_ = usual;
}

void LaunchContention::judge(nanoseconds now) {
    slowdown_ = beside_.quantile(kMedian);
    if (slowdown_ < kFreeBelow) {
        verdict_ = Launching::kFree;
        retry_ = kRetry;
        return;
    }
    if (done_.count < kTogetherFirst) return;
    together_ = done_.quantile(kMedian);
    if (slowdown_ >= kSlowedFrom && together_ <= kSerialUpTo) {
        if (verdict_ != Launching::kSlowed) found_ = now;
        verdict_ = Launching::kSlowed;
    } else if (together_ >= kParallelFrom && verdict_ != Launching::kFree) {
        verdict_ = Launching::kParallel;
        retry_ = kRetry;
    } else if (verdict_ == Launching::kParallel && together_ <= kSerialUpTo) {
        verdict_ = Launching::kUnknown;
    }
}

}  // namespace urgengo::model
