// SPDX-License-Identifier: Apache-2.0
#include "host/exec/cheap_waits.h"

#include <algorithm>

#include "host/exec/relaxed_capture_mode.h"

namespace urgengo::exec {
namespace {

/// The first sleep of a task that is alone.
constexpr nanoseconds kFirstAlone{150'000};
/// One sleep: what is left may turn out to be less than was thought.
constexpr nanoseconds kLongestSleep{1'000'000};
/// Beyond twice what was expected. The program's call waits for what is there when it is made; a
/// stream that others keep feeding is never seen idle, so the call must not be put off for long.
constexpr nanoseconds kPatience{5'000'000};

}  // namespace

CUresult CheapWaits::ask_whether_over(const Goal& goal) const {
    // In another mode a question of ours would end a capture of another thread's.
    const RelaxedCaptureMode relaxed(driver_);
    if (goal.event) return driver_.cuEventQuery(goal.event);
    return goal.flavor == StreamFlavor::kPerThread ? driver_.cuStreamQuery_ptsz(goal.stream)
                                                   : driver_.cuStreamQuery(goal.stream);
}

void CheapWaits::sleep_until_over(const Goal& goal, sched::GovernedTask* task) const {
    if (captures_.any() || ask_whether_over(goal) != CUDA_ERROR_NOT_READY) return;
    const auto expected = [&](nanoseconds now) {
        return task ? governor_.tasks().look(*task, now).ahead.launched : nanoseconds{0};
    };
    const FineTimerSlack slack;
    const nanoseconds begin = clock_.now();
    const nanoseconds longest = kPatience + 2 * expected(begin);
    nanoseconds now = begin;
    do {
        const nanoseconds interval = asking_interval(now - begin);
        nanoseconds most = expected(now) * 3 / 4;
        // A task alone is marked seldom, and may be further than is known.
        if (governor_.company().is_alone())
            most = std::min(most, std::max(kFirstAlone, now - begin));
        clock_.sleep_for(std::clamp(most, interval, kLongestSleep));
        now = clock_.now();
    } while (now - begin < longest && !captures_.any() && are_on() &&
             ask_whether_over(goal) == CUDA_ERROR_NOT_READY);
}

}  // namespace urgengo::exec
