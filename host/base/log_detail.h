// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace urgengo {

/// How much own_log.h writes.
enum class LogDetail : std::uint8_t { kOff = 0, kInfo = 1, kDebug = 2 };

}  // namespace urgengo
