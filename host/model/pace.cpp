// SPDX-License-Identifier: Apache-2.0
#include "host/model/pace.h"

#include <algorithm>

namespace urgengo::model {
namespace {

double to_double(nanoseconds t) {
    return static_cast<double>(t.count());
}

}  // namespace

void Pace::saw(const LaunchLog& log, const SeenMark& mark, bool shared) {
    if (busy_.test_and_set(std::memory_order_acquire)) return;
    const SeenMark last = last_;
    const bool is_newer = static_cast<std::int32_t>(mark.sequence - last.sequence) > 0;
    if (!is_known_ || is_newer) {
        const std::uint32_t first = log.launches_before_mark(last.sequence);
        const std::uint32_t end = log.launches_before_mark(mark.sequence);
        const nanoseconds work = log.end(end - 1) - log.end(first - 1);
        const nanoseconds begin = std::max(last.time, log.time(first) + kLaunchLatency);
        const bool tells = is_known_ && first != end && log.still_holds(first - 1, last.sequence);
        if (tells && work.count() > 0 && mark.time > begin) {
            const double ratio = to_double(mark.time - begin) / to_double(work);
            const double weight = to_double(work) / to_double(work + kHalf);
            std::atomic<float>& pace = pace_[shared ? 1 : 0];
            const double before = value(shared);
            pace.store(static_cast<float>(
                           before + weight * (std::clamp(ratio, kMinPace, kMaxPace) - before)),
                       std::memory_order_relaxed);
        }
        last_ = mark;
        is_known_ = true;
    }
    busy_.clear(std::memory_order_release);
}

}  // namespace urgengo::model
