// SPDX-License-Identifier: Apache-2.0
//
// Modes of the status page and of run records, as people read them.
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

}  // namespace urgengo::observe
