// SPDX-License-Identifier: Apache-2.0
#include "host/sched/bystanders.h"

#include <algorithm>

namespace urgengo::sched {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
constexpr float kSlowDownGain = 0.25F;
/// Of windows: 0.2 s after the last launch of one that was busy.
constexpr float kGone = 0.02F;
/// One instance that met something else than the bystander does not tell more than this.
constexpr float kMostSlowDown = 4;

}  // namespace

bool Bystanders::window_ended(nanoseconds now) {
    std::int64_t next = next_ns_.load(kRelaxed);
    return now.count() >= next &&
           next_ns_.compare_exchange_strong(next, (now + kWindow).count(), kRelaxed);
}

bool Bystanders::saw(bool launched) {
    const float share = share_.load(kRelaxed);
    const float now_share = share + kGain * ((launched ? 1.0F : 0.0F) - share);
    share_.store(now_share, kRelaxed);
    const float slow_down = slow_down_.load(kRelaxed);
    const bool matters = slow_down == 0 || slow_down >= kSlowed;
    const bool was_busy = are_busy();
    const bool busy = matters && now_share >= (was_busy ? kIdle : kBusy);
    busy_.store(busy, kRelaxed);
    // What is known of one that has gone says nothing of the next.
    if (!launched && now_share < kGone) {
        slow_down_.store(0, kRelaxed);
        delay_ns_.store(0, kRelaxed);
    }
    return busy != was_busy;
}

void Bystanders::measured(nanoseconds took, nanoseconds alone, std::uint32_t launches) {
    if (alone.count() <= 0 || launches == 0) return;
    const auto follow = [](std::atomic<float>& average, float value) {
        const float last = average.load(kRelaxed);
        average.store(last == 0 ? value : last + kSlowDownGain * (value - last), kRelaxed);
    };
    const auto took_ns = static_cast<float>(took.count());
    const auto alone_ns = static_cast<float>(alone.count());
    follow(slow_down_, std::clamp(took_ns / alone_ns, 1.0F, kMostSlowDown));
    follow(delay_ns_, std::max(took_ns - alone_ns, 1.0F) / static_cast<float>(launches));
}

}  // namespace urgengo::sched
