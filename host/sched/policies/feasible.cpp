// SPDX-License-Identifier: Apache-2.0
#include "host/sched/policies/feasible.h"

#include <algorithm>
#include <array>

namespace urgengo::sched {
namespace {

/// Given-up instances rank behind the kept ones and before the hopeless ones.
constexpr Key kGivenUp = kLate / 2;

/// When the instance's GPU work must be done for the rest to be in time.
nanoseconds gpu_deadline(const SlotView& v) {
    return v.deadline - v.remaining_cpu;
}

/// What giving up the instance frees for what it costs.
double gain(const SlotView& v) {
    return static_cast<double>(v.remaining_gpu.count()) /
           static_cast<double>(std::max<std::int64_t>(v.period.count(), 1));
}

}  // namespace

void feasible_keys(const Snapshot& snapshot, std::span<Key> keys) {
    const std::span<const SlotView> tasks = snapshot.tasks;
    std::array<std::uint8_t, abi::kMaxTasks> by_deadline;
    std::size_t n = 0;
    for (std::size_t i = 0; i < tasks.size(); ++i) {
        keys[i] = gpu_deadline(tasks[i]).count();
        if (tasks[i].laxity.count() < 0)
            keys[i] += kLate;
        else
            by_deadline[n++] = static_cast<std::uint8_t>(i);
    }
    std::sort(by_deadline.begin(), by_deadline.begin() + n, [&](auto a, auto b) {
        return std::pair(gpu_deadline(tasks[a]), tasks[a].task) <
               std::pair(gpu_deadline(tasks[b]), tasks[b].task);
    });

    nanoseconds finish = snapshot.now;
    for (std::size_t end = 0; end < n; ++end) {
        const SlotView& last = tasks[by_deadline[end]];
        finish += last.remaining_gpu;
        // One may free too little: until what is kept fits, or the last one is given up itself.
        while (finish > gpu_deadline(last) && keys[by_deadline[end]] < kGivenUp) {
            std::size_t worst = end;
            for (std::size_t i = 0; i < end; ++i)
                if (keys[by_deadline[i]] < kGivenUp &&
                    gain(tasks[by_deadline[i]]) > gain(tasks[by_deadline[worst]]))
                    worst = i;
            finish -= tasks[by_deadline[worst]].remaining_gpu;
            keys[by_deadline[worst]] += kGivenUp;
        }
    }
}

}  // namespace urgengo::sched
