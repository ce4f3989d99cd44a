// SPDX-License-Identifier: Apache-2.0
#include "host/sched/urgent_threshold.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "host/base/memory_orders.h"

namespace urgengo::sched {
namespace {

constexpr int kStepBits = 4;  // 16 steps an octave

std::size_t step_of(nanoseconds laxity) {
    const auto ns =
        static_cast<std::uint64_t>(std::max<std::int64_t>(laxity.count(), 1 << kStepBits));
    const int octave = std::bit_width(ns) - 1;
    return (static_cast<std::size_t>(octave) << kStepBits) |
           (ns >> (octave - kStepBits) & ((1u << kStepBits) - 1));
}

std::int64_t end_of_step(std::size_t step) {
    const auto octave = static_cast<int>(step >> kStepBits);
    const std::uint64_t within = step & ((1u << kStepBits) - 1);
    return static_cast<std::int64_t>(((1u << kStepBits) + within + 1) << (octave - kStepBits));
}

}  // namespace

bool UrgentThreshold::is_due(nanoseconds now) {
    nanoseconds last = last_.load(kRelaxed);
    return now - last >= kEvery && last_.compare_exchange_strong(last, now, kRelaxed);
}

void UrgentThreshold::record(nanoseconds laxity) {
    counts_[step_of(laxity)].fetch_add(1, kRelaxed);
    if ((num_records_.fetch_add(1, kRelaxed) + 1) % kEnough == 0) reckon();
}

// The share of laxities below it is that of urgencies above the percentile.
void UrgentThreshold::reckon() {
    std::uint64_t total = 0;
    for (const auto& count : counts_) total += count.load(kRelaxed);
    const double below = static_cast<double>(total) * (1 - percentile_ / 100);
    double sum = 0;
    for (std::size_t step = 0; step < kSteps; ++step) {
        sum += counts_[step].load(kRelaxed);
        if (sum <= below || counts_[step].load(kRelaxed) == 0) continue;
        return laxity_ns_.store(end_of_step(step), kRelaxed);
    }
}

std::optional<nanoseconds> UrgentThreshold::laxity() const {
    const std::int64_t ns = laxity_ns_.load(kRelaxed);
    if (ns < 0) return std::nullopt;
    return nanoseconds(ns);
}

}  // namespace urgengo::sched
