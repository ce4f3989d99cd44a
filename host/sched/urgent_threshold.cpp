// SPDX-License-Identifier: Apache-2.0
#include "host/sched/urgent_threshold.h"

#include "host/base/memory_orders.h"
#include "host/sched/urgent_steps.h"

namespace urgengo::sched {

bool UrgentThreshold::is_due(nanoseconds now) {
    nanoseconds last = last_.load(kRelaxed);
    return now - last >= kEvery && last_.compare_exchange_strong(last, now, kRelaxed);
}

void UrgentThreshold::record(nanoseconds laxity) {
    counts_[urgent_step_of(laxity.count())].fetch_add(1, kRelaxed);
    if ((num_records_.fetch_add(1, kRelaxed) + 1) % kEnough == 0) reckon();
}

void UrgentThreshold::reckon() {
    std::uint64_t total = 0;
    for (const auto& count : counts_) total += count.load(kRelaxed);
    const double below = urgent_records(total, percentile_);
    double sum = 0;
    for (std::uint32_t step = 0; step < abi::kUrgentSteps; ++step) {
        sum += counts_[step].load(kRelaxed);
        if (sum > below) return laxity_ns_.store(end_of_urgent_step(step), kRelaxed);
    }
}

std::optional<nanoseconds> UrgentThreshold::laxity() const {
    const std::int64_t ns = laxity_ns_.load(kRelaxed);
    if (ns < 0) return std::nullopt;
    return nanoseconds(ns);
}

}  // namespace urgengo::sched
