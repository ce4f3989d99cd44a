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

void add_detail(nlohmann::ordered_json& frame, abi::MissCause cause, std::uint16_t detail) {
    if (detail == 0) return;
    if (const double times = observe::times_as_long(cause, detail); times > 0)
        frame["times_as_long"] = times;
    if (const auto time = observe::short_by(cause, detail); time.count() > 0)
        frame["short_by_ms"] = to_ms(time.count());
}

}  // namespace urgengo::trace
