// SPDX-License-Identifier: Apache-2.0
#include "host/model/mark_spacing.h"

namespace urgengo::model {
namespace {

// Between 1 - dither and 1 + dither, as good as at random.
double dithered(const MarkSpacing& spacing, std::uint32_t sequence) {
    const std::uint32_t hash = (sequence ^ sequence >> 15) * 0x9e3779b1u;
    return 1 + spacing.dither * (static_cast<double>(hash >> 8) / (1 << 23) - 1);
}

}  // namespace

nanoseconds wanted_distance(const MarkSpacing& spacing, const MarkSituation& at) {
    if (at.laxity.count() < 0) return spacing.every;
    return std::clamp(std::max(at.laxity, at.remaining) / kNearEnd, spacing.every / 4,
                      spacing.every);
}

bool mark_is_due(const MarkSpacing& spacing, const MarkSituation& at, const MarkBudget& budget) {
    if (at.since_mark.count() <= 0) return false;
    const double cost_ns = static_cast<double>(spacing.cost.count());
    if (at.at_segment_end) return budget.balance_ns() >= cost_ns * (1 - MarkBudget::kMaxOwed);
    if (budget.balance_ns() < cost_ns) return false;
    const nanoseconds wanted = wanted_distance(spacing, at);
    const nanoseconds is_long = spacing.every / 2;
    if (at.last_launch >= is_long || at.next_launch >= is_long) return true;
    if (at.to_segment_end.count() > 0 && at.to_segment_end <= wanted / 4) return false;
    return static_cast<double>((at.since_mark + at.next_launch / 2).count()) >=
           static_cast<double>(wanted.count()) * dithered(spacing, at.sequence);
}

}  // namespace urgengo::model
