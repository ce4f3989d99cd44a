// SPDX-License-Identifier: Apache-2.0
//
// What a wait is called in profiles (SegmentProfile::closed_by): by the tools that learn them, and
// by the runtime that follows them.
#pragma once

#include <string_view>

#include "urgengo/abi/trace_record.h"

namespace urgengo::observe {

constexpr std::string_view wait_name(abi::TraceWait wait) {
    switch (wait) {
        case abi::TraceWait::kStream:
            return "stream";
        case abi::TraceWait::kContext:
            return "context";
        case abi::TraceWait::kEvent:
            return "event";
        case abi::TraceWait::kCopy:
            return "copy";
        case abi::TraceWait::kStreamQuery:
            return "stream_query";
        case abi::TraceWait::kEventQuery:
            return "event_query";
    }
    return "unknown";  // in a trace that another version wrote
}

}  // namespace urgengo::observe
