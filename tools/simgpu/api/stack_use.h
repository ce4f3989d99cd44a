// SPDX-License-Identifier: Apache-2.0
//
// Calls that take much of the calling thread's stack in the driver take it here, too: a thread that
// lives with the driver alone may not with what is called in its place.
#pragma once

#include <cstddef>

#include "host/base/sanitized.h"

namespace urgengo::simgpu {

/// Of a module's loading, measured (580.159.04). A stream's making is taken to need the same:
/// threads with stacks of 16 KiB died where streams were made in them (H200, 580.159.04).
constexpr std::size_t kStackOfLargeCalls = 20 * 1024;

/// Touches so much of the stack; nothing under a sanitizer, whose frames are larger than those
/// that such threads have room for.
[[gnu::noinline]] inline void use_stack_of_large_call() {
#if !URGENGO_SANITIZED
    constexpr std::size_t kPage = 4096;
    auto* const room = static_cast<volatile char*>(__builtin_alloca(kStackOfLargeCalls));
    // From the top down, so that it meets a guard page however small.
    for (std::size_t i = kStackOfLargeCalls; i > kPage; i -= kPage) room[i - 1] = 1;
    room[0] = 1;
#endif
}

}  // namespace urgengo::simgpu
