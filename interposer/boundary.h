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

#include "interposer/jumped.h"
#include "interposer/lifecycle.h"
#include "interposer/real_driver.h"

namespace urgengo::interposer {

/// Marks the calling thread as inside for as long as the object lives (a cancelled thread, too).
class Inside {
  public:
    explicit Inside(runtime::ThreadLine& thread = t_this.line) : thread_(thread) {
        thread_.inside = true;
    }
    ~Inside() { thread_.inside = false; }
    Inside(const Inside&) = delete;
    Inside& operator=(const Inside&) = delete;

  private:
    runtime::ThreadLine& thread_;
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
    return armed() && (!t_this.line.inside || has_jumped_out());
}
/// The same for calls that need not start UrgenGo.
inline bool acts_already() {
    if (is_armed() & !t_this.line.inside) [[likely]]
        return true;
    return t_this.line.inside && has_jumped_out();
}

/// @returns whether a launch on `stream` is only forwarded: UrgenGo is off for good, or the
/// thread's launches there are a bystander's. A wrapper that asks this first, and leaves all else
/// to a function that is never inlined, is a few loads and a jump: its arguments stay where they
/// are.
inline bool is_bystanders_launch(CUstream stream) {
    const State state = g_every_call.state.load(std::memory_order_acquire);
    if (state != State::kArmed) [[unlikely]]
        return state == State::kOff;
    const runtime::ThreadLine& thread = this_thread_when_armed().line;
    return thread.passes & (thread.passes_stream == stream);
}

/// Of a bystander's launch: read by all threads, hardly ever written.
inline void note_bystander() {
    std::atomic<bool>& launched = g_every_call.bystander_launched;
    if (!launched.load(std::memory_order_relaxed)) [[unlikely]]
        launched.store(true, std::memory_order_relaxed);
}

/// @returns the real driver if a launch on `stream` is only forwarded, else null
inline const exec::DriverApi* real_if_bystanders_launch(CUstream stream) {
    if (!is_bystanders_launch(stream)) return nullptr;
    note_bystander();
    return g_every_call.real.load(std::memory_order_acquire);
}

/// The same for a call that waits. Now and then it is not only forwarded, even so: the thread's
/// name is read again after it.
inline const exec::DriverApi* real_if_bystander_waits() {
    const State state = g_every_call.state.load(std::memory_order_acquire);
    if (state == State::kArmed) {
        ThisThread& thread = this_thread_when_armed();
        if (!thread.line.passes) return nullptr;
        if (--thread.line.waits_to_pass == 0)
            thread.line.passes = thread.state->serves.name_is_fresh = false;
    } else if (state != State::kOff) {
        return nullptr;
    }
    return g_every_call.real.load(std::memory_order_acquire);
}

/// The same for a call that only tells something of the thread's own launches.
inline const exec::DriverApi* real_if_bystanders_event() {
    const State state = g_every_call.state.load(std::memory_order_acquire);
    const bool passes = state == State::kArmed && this_thread_when_armed().line.passes;
    if (state != State::kOff && !passes) return nullptr;
    return g_every_call.real.load(std::memory_order_acquire);
}

/// The same for an asynchronous copy: mostly, as nothing becomes of copies unless the config asks
/// for it.
inline const exec::DriverApi* real_if_copies_pass() {
    if (g_every_call.changes_copies.load(std::memory_order_relaxed)) [[unlikely]]
        return real_if_bystanders_event();
    return g_every_call.real.load(std::memory_order_acquire);
}

}  // namespace urgengo::interposer
