// SPDX-License-Identifier: Apache-2.0
//
// What `urgengo trace why --json` and `urgengo report --json` tell alike of a frame. Times in ms.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "tools/trace/run_summary.h"

namespace urgengo::trace {

/// @returns [{"chain", "ms"}]
nlohmann::ordered_json times_json(const Run& run, const std::vector<TimeOfChain>& times);
/// @returns [{"begin_ms", "end_ms", "depth", "what"}]
nlohmann::ordered_json story_json(const std::vector<StoryLine>& lines);
/// Adds what is known of a late frame's cause besides: "times_as_long" or "short_by_ms".
/// @param detail  as abi::MissCause says of it
void add_detail(nlohmann::ordered_json& frame, abi::MissCause cause, std::uint16_t detail);

}  // namespace urgengo::trace
