// SPDX-License-Identifier: Apache-2.0
//
// Whether UrgenGo acts in this process, from the first call to the end.
//
//   kCold --first launch or hint--> kArmed --second trip(), fork (in the child)--> kOff
//     \______________ no config, broken config, mode off _________________________/^
//
// kOff is for good: every wrapper is then one load, one compare, and the real function. The first
// trip() leaves kArmed, and the runtime observes from there on.
#pragma once

#include "host/runtime/runtime.h"
#include "interposer/every_call.h"

namespace urgengo::interposer {

/// Has every child forked from here on pass through, unless it can start by itself. At load.
void watch_forks();

/// Reads the config and makes the runtime; says in one line on stderr why not, if not. Once.
void start();

/// Stops scheduling, for good, and says why; the second time stops acting. Any thread.
void trip(const char* reason);

/// Valid while armed() holds.
runtime::Runtime& the_runtime();

/// @returns the calling thread's state, made at its first use; null if the thread is ending
runtime::ThreadState* this_thread();

/// @returns whether UrgenGo acts; starts it if nothing has yet
inline bool armed() {
    const State state = g_every_call.state.load(std::memory_order_acquire);
    if (state == State::kOff) [[likely]]
        return false;
    if (state == State::kCold) {
        start();
        return g_every_call.state.load(std::memory_order_acquire) == State::kArmed;
    }
    return true;
}

/// @returns whether UrgenGo acts already; never starts it
inline bool is_armed() {
    return g_every_call.state.load(std::memory_order_acquire) == State::kArmed;
}

}  // namespace urgengo::interposer
