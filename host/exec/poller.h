// SPDX-License-Identifier: Apache-2.0
//
// What looks again and again while there is something to see: live a thread of ours, in tests the
// test itself.
//
// The thread is no part of the program (host/base/own_thread.h), has a timer slack of its own, and
// takes none of the program's locks. With nothing to see it sleeps until it is woken. When the
// program exits it stops before the driver goes, whose handlers of exit were registered earlier:
// the thread is made when there is a context.
#pragma once

#include <atomic>
#include <functional>
#include <mutex>

#include "host/base/clock.h"

namespace urgengo::exec {

/// What a look has found: whether there is more to see, and how soon a task wants to know.
enum class More { kNone, kLater, kSoon };

/// For how long a thread sleeps until it looks again.
constexpr nanoseconds rest_after(More more) {
    return more == More::kLater ? nanoseconds{100'000} : nanoseconds{20'000};
}

class Poller {
  public:
    virtual ~Poller() = default;
    /// Makes `look` be called. Once, before any wake().
    /// @returns whether it will be
    /// @param stopped  called when there will be no look any more, and the process goes on
    virtual bool start(std::function<More()> look, std::function<void()> stopped = {}) = 0;
    /// There is something to see. Called after it can be seen.
    /// @returns whether it will be looked at
    virtual bool wake() = 0;
};

/// Never destroyed once it is started.
class PollerThread final : public Poller {
  public:
    /// @param rests  sleeps between two looks; else takes a core while there is something to see
    explicit PollerThread(bool rests = true) : rests_(rests) {}
    bool start(std::function<More()> look, std::function<void()> stopped = {}) override;
    /// A system call if the thread sleeps for want of work, else a load.
    bool wake() override;

  private:
    static void run(void* self);
    void look_for_ever();
    More look_unless_stopped();
    void park();
    static void stop_all();
    void stop();

    const bool rests_;
    std::function<More()> look_;
    std::function<void()> on_stop_;
    std::mutex looking_;  // held during a look
    std::atomic<bool> stopped_{false};
    int process_ = 0;               // that has the thread
    PollerThread* next_ = nullptr;  // of those that stop_all() stops
    std::atomic<int> parked_{0};    // a futex
};

}  // namespace urgengo::exec
