// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/page/tame_slot.h"

#include <algorithm>

namespace urgengo::cli {
namespace {

// 2^53 as a difference, 64 times that, and four times that again, stay below 2^63.
constexpr std::int64_t kLongest = std::int64_t{1} << 53, kLatest = std::int64_t{1} << 58;
constexpr std::uint32_t kMostFactor_ppm = 64'000'000;

template <typename T>
void clamp(std::atomic<T>& value, T least, T most) {
    value.store(std::clamp(value.load(std::memory_order_relaxed), least, most),
                std::memory_order_relaxed);
}

}  // namespace

void tame_slot(abi::TaskSlot& slot) {
    for (auto* const clock : {&slot.deadline_ns, &slot.cpu_until_ns, &slot.launch_ns, &slot.look_ns,
                              &slot.sync_until_ns, &slot.progress_ns, &slot.cleared_until_ns,
                              &slot.turn_until_ns, &slot.unmarked_until, &slot.lent_deadline_ns,
                              &slot.queue_since_ns, &slot.gate_by_ns, &slot.gate_opened_ns})
        clamp(*clock, -kLatest, kLatest);
    for (auto* const duration :
         {&slot.later_gpu_ns, &slot.later_cpu_ns, &slot.period_ns, &slot.head_remaining_ns,
          &slot.head_idle_ns, &slot.launched_ns, &slot.gave_way_ns, &slot.turn_at_ns,
          &slot.lent_until_ns, &slot.relative_deadline_ns, &slot.chain_gpu_ns, &slot.chain_cpu_ns,
          &slot.later_idle_ns, &slot.chain_idle_ns, &slot.run_ahead_ns})
        clamp(*duration, -kLongest, kLongest);
    for (auto& launched : slot.launched_at_mark_ns) clamp(launched, -kLongest, kLongest);
    for (auto& begin : slot.group_begin_ns) clamp(begin, -kLongest, kLongest);
    for (auto& time : slot.group_time_ns) clamp(time, -kLongest, kLongest);
    clamp(slot.factor_ppm, std::uint32_t{0}, kMostFactor_ppm);
}

}  // namespace urgengo::cli
