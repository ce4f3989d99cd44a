// SPDX-License-Identifier: Apache-2.0
//
// What wrappers look at in every call: one cache line of the process, and one of the thread's.
#pragma once

#include <atomic>

#include "host/exec/driver_api.h"

namespace urgengo::runtime {
struct ThreadState;
}

namespace urgengo::interposer {

enum class State : int { kCold, kArmed, kOff };  ///< lifecycle.h

struct alignas(64) EveryCall {
    std::atomic<State> state{State::kCold};
    /// The config asks for something to become of copies. Never while kCold; stays when kOff.
    std::atomic<bool> changes_copies{false};
    /// What real() answers, once the driver is loaded (real_driver.h).
    std::atomic<const exec::DriverApi*> real{nullptr};
};
extern constinit EveryCall g_every_call;

struct alignas(16) ThisThread {
    /// Null before the thread's first call that needs one.
    runtime::ThreadState* state = nullptr;
    /// Inside a wrapper: what the driver, or a library inside it, calls from there passes through.
    bool inside = false;
};
extern constinit thread_local ThisThread t_this __attribute__((tls_model("initial-exec")));

}  // namespace urgengo::interposer
