// SPDX-License-Identifier: Apache-2.0
#include "host/sched/core_load.h"

#include <algorithm>

#include "host/base/memory_orders.h"

namespace urgengo::sched {
namespace {

constexpr std::int64_t kBusyFrom = 2, kFreeBelow = 10;  // one of so many parts of the time

}  // namespace

void CoreLoad::slept(nanoseconds asked, nanoseconds took, nanoseconds now) {
    const std::int64_t late = std::max<std::int64_t>((took - asked).count() - kUsual_ns, 0);
    took_ns_.fetch_add(took.count(), kRelaxed);
    late_ns_.fetch_add(late, kRelaxed);
    sleeps_.fetch_add(1, kRelaxed);
    std::int64_t begin = begin_ns_.load(kRelaxed);
    if (now.count() - begin < kWindow.count()) return;
    if (!begin_ns_.compare_exchange_strong(begin, now.count(), kRelaxed)) return;
    const int sleeps = sleeps_.exchange(0, kRelaxed);
    const std::int64_t total_late = late_ns_.exchange(0, kRelaxed);
    const std::int64_t total = took_ns_.exchange(0, kRelaxed);
    if (sleeps < kLeast) return;
    if (total_late * kBusyFrom >= total) are_busy_.store(true, kRelaxed);
    if (total_late * kFreeBelow < total) are_busy_.store(false, kRelaxed);
    windows_.fetch_add(1, kRelaxed);
    if (are_busy()) busy_.fetch_add(1, kRelaxed);
}

}  // namespace urgengo::sched
