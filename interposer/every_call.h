// SPDX-License-Identifier: Apache-2.0
//
// What wrappers look at in every call: one cache line of the process, and one of the thread's.
#pragma once

#include <atomic>
#include <cstddef>

#include "host/exec/driver_api.h"
#include "host/runtime/thread_line.h"

namespace urgengo::runtime {
struct ThreadState;
}

namespace urgengo::interposer {

enum class State : int { kCold, kArmed, kOff };  ///< lifecycle.h

struct alignas(64) EveryCall {
    std::atomic<State> state{State::kCold};
    /// The config asks for something to become of copies. Never while kCold; stays when kOff.
    std::atomic<bool> changes_copies{false};
    /// A launch of no chain was made; cleared by the runtime now and then.
    std::atomic<bool> bystander_launched{false};
    /// From a thread's pointer to its t_this, in bytes. Where that lies the loader keeps elsewhere:
    /// a line and a page more. From kArmed on.
    std::ptrdiff_t this_thread = 0;
    /// What real() answers, once the driver is loaded (real_driver.h).
    std::atomic<const exec::DriverApi*> real{nullptr};
    /// Of that, what is called the most; null before.
    std::atomic<decltype(exec::DriverApi::cuLaunchKernel)> launch{nullptr}, launch_ptsz{nullptr};
    std::atomic<decltype(exec::DriverApi::cuLaunchKernelEx)> launch_ex{nullptr},
        launch_ex_ptsz{nullptr};
};
static_assert(sizeof(EveryCall) == 64);
extern constinit EveryCall g_every_call;

struct ThisThread {
    runtime::ThreadLine line;
    /// Null before the thread's first call that needs one.
    runtime::ThreadState* state = nullptr;
};
extern constinit thread_local ThisThread t_this __attribute__((tls_model("initial-exec")));

/// @returns t_this, while kArmed
inline ThisThread& this_thread_when_armed() {
    return *reinterpret_cast<ThisThread*>(static_cast<char*>(__builtin_thread_pointer()) +
                                          g_every_call.this_thread);
}

}  // namespace urgengo::interposer
