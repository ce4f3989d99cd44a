// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/busy_time.h"

#include <algorithm>

namespace urgengo::trace {

std::int64_t BusyTime::add(std::int64_t begin_ns, std::int64_t end_ns) {
    if (end_ns <= begin_ns) return 0;
    std::int64_t covered_ns = 0, from_ns = begin_ns, to_ns = end_ns;
    auto next = busy_.upper_bound(begin_ns);
    if (next != busy_.begin() && std::prev(next)->second >= begin_ns) --next;
    while (next != busy_.end() && next->first <= end_ns) {
        covered_ns += std::min(end_ns, next->second) - std::max(begin_ns, next->first);
        from_ns = std::min(from_ns, next->first);
        to_ns = std::max(to_ns, next->second);
        next = busy_.erase(next);
    }
    busy_.emplace(from_ns, to_ns);
    const std::int64_t growth_ns = end_ns - begin_ns - covered_ns;
    total_ns_ += growth_ns;
    return growth_ns;
}

}  // namespace urgengo::trace
