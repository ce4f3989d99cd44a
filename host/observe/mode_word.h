// SPDX-License-Identifier: Apache-2.0
//
// Modes of the status page and of run records: as people read them, and which is the weaker one.
#pragma once

#include "urgengo/abi/status_page.h"

namespace urgengo::observe {

constexpr const char* to_word(abi::StatusMode mode) {
    switch (mode) {
        case abi::StatusMode::kOff:
            return "off";
        case abi::StatusMode::kObserve:
            return "observe";
        case abi::StatusMode::kEnforce:
            return "enforce";
        case abi::StatusMode::kTripped:
            return "tripped";
        case abi::StatusMode::kShadow:
            return "shadow";
    }
    return "unknown";  // another version's
}

/// @param a, b  not kTripped
/// @returns the one that does less. The numbers are not in that order: kShadow came last
constexpr abi::StatusMode weaker(abi::StatusMode a, abi::StatusMode b) {
    using abi::StatusMode;
    for (const StatusMode mode : {StatusMode::kOff, StatusMode::kObserve, StatusMode::kShadow})
        if (a == mode || b == mode) return mode;
    return a;
}

}  // namespace urgengo::observe
