// SPDX-License-Identifier: Apache-2.0
#include "host/model/cpu_segments.h"

#include <algorithm>

namespace urgengo::model {

CpuSegments::CpuSegments(std::span<const nanoseconds> profile)
    : segments_(std::min(profile.size(), kMaxSegments)) {
    for (std::size_t i = 0; i < segments_.size(); ++i) segments_[i] = {profile[i].count(), 0, 1};
    sum_up();
}

void CpuSegments::observe(std::size_t segment, nanoseconds time) {
    if (segment >= segments_.size()) return;
    Segment& s = segments_[segment];
    if (s.instances > 0) time = std::min(time, kMostTimes * nanoseconds(s.mean_ns) + kMostMore);
    s.instances = std::min(s.instances + 1, kWindow);
    s.mean_ns += (time.count() - s.mean_ns) / static_cast<std::int64_t>(s.instances);
}

void CpuSegments::end_instance(std::size_t num_segments) {
    segments_.resize(std::max(segments_.size(), std::min(num_segments, kMaxSegments)));
    sum_up();
}

void CpuSegments::sum_up() {
    std::int64_t later_ns = 0;
    for (auto s = segments_.rbegin(); s != segments_.rend(); ++s) {
        s->later_ns = later_ns;
        later_ns += s->mean_ns;
    }
}

}  // namespace urgengo::model
