// SPDX-License-Identifier: Apache-2.0
//
// Room for what happens once and needs much stack, such as reading a config: the program's thread
// in which it happens may have been given 16 KiB.
#pragma once

namespace urgengo {

/// Calls `function(argument)` in the calling thread, on a stack of 256 KiB that is given back
/// afterwards; without memory for it, on the thread's own. Not to be cancelled meanwhile.
/// @param function  throws nothing
void on_roomy_stack(void (*function)(void*), void* argument);

/// The same of what is not ours, and may need as much as a program's thread usually has: on the
/// thread's own stack if that has more room than a roomy one, as it would be without us; else on
/// one of 8 MiB.
void on_large_stack(void (*function)(void*), void* argument);

// The same of what may be called without an argument, and throws nothing.

template <typename Callable>
void on_roomy_stack(Callable callable) {
    on_roomy_stack([](void* argument) noexcept { (*static_cast<Callable*>(argument))(); },
                   &callable);
}

template <typename Callable>
void on_large_stack(Callable callable) {
    on_large_stack([](void* argument) noexcept { (*static_cast<Callable*>(argument))(); },
                   &callable);
}

}  // namespace urgengo
