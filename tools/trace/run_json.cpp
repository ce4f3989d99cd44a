// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/run_json.h"

#include <nlohmann/json.hpp>

namespace urgengo::trace {

nlohmann::ordered_json times_json(const Run& run, const std::vector<TimeOfChain>& times) {
    auto all = nlohmann::ordered_json::array();
    for (const TimeOfChain& each : times)
        all.push_back({{"chain", run.chains[each.chain].name}, {"ms", to_ms(each.time_ns)}});
    return all;
}

nlohmann::ordered_json story_json(const std::vector<StoryLine>& lines) {
    auto all = nlohmann::ordered_json::array();
    for (const StoryLine& line : lines)
        all.push_back({{"begin_ms", to_ms(line.begin_ns)},
                       {"end_ms", to_ms(line.end_ns)},
                       {"depth", line.depth},
                       {"what", line.what}});
    return all;
}

}  // namespace urgengo::trace
