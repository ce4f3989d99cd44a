// SPDX-License-Identifier: Apache-2.0
//
// The boundary between the program's call and our work around it. Every wrapper in manual/ has the
// shape
//
//     our work before;  result = the real call;  our work after;  return result;
//
// with our work inside protect(): so the program's call is forwarded exactly once, in its own
// thread, and its result is the driver's, whatever happens to us.
#pragma once

#include <cxxabi.h>

#include <cerrno>
#include <utility>

#include "interposer/lifecycle.h"
#include "interposer/real_driver.h"

namespace urgengo::interposer {

/// True while the calling thread is inside a wrapper: what the driver, or a library inside it,
/// calls from there passes through.
extern constinit thread_local bool t_inside __attribute__((tls_model("initial-exec")));

/// Marks the calling thread as inside for as long as the object lives (a cancelled thread, too).
class Inside {
  public:
    Inside() { t_inside = true; }
    ~Inside() { t_inside = false; }
    Inside(const Inside&) = delete;
    Inside& operator=(const Inside&) = delete;
};

/// Runs our own work. Leaves errno alone; an exception ends our work for good, not the program's.
/// Cancellation of the thread is not an exception of ours: it goes on.
template <typename Work>
void protect(Work&& work) {
    const int saved_errno = errno;
    try {
        std::forward<Work>(work)();
    } catch (__cxxabiv1::__forced_unwind&) {
        throw;
    } catch (...) {
        trip("an internal error");
    }
    errno = saved_errno;
}

/// @returns whether this call is the program's and UrgenGo acts
inline bool acts() {
    return armed() && !t_inside;
}
/// @returns the real driver while UrgenGo is off for good and the driver is loaded, else null. A
/// wrapper that asks this first and leaves all else to a function that is never inlined is then two
/// loads and a jump: its arguments stay where they are.
inline const exec::DriverApi* real_if_off() {
    if (g_state.load(std::memory_order_acquire) != State::kOff) return nullptr;
    return detail::g_real.load(std::memory_order_acquire);
}
/// The same for calls that need not start UrgenGo.
inline bool acts_already() {
    return is_armed() && !t_inside;
}

}  // namespace urgengo::interposer
