// SPDX-License-Identifier: Apache-2.0
//
// Short names for the memory orders, which stand at most accesses to what threads share.
#pragma once

#include <atomic>

namespace urgengo {

inline constexpr auto kRelaxed = std::memory_order_relaxed;
inline constexpr auto kAcquire = std::memory_order_acquire;
inline constexpr auto kRelease = std::memory_order_release;

}  // namespace urgengo
