// SPDX-License-Identifier: Apache-2.0
#include "host/exec/poller.h"

#include <linux/futex.h>
#include <sched.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cstdlib>
#include <utility>

#include "host/base/clock.h"
#include "host/base/own_thread.h"

namespace urgengo::exec {
namespace {

/// Between two looks. A sleep takes some 30 us more (host/base/clock.h). With 5 us events are known
/// of 3 us earlier in the median, for up to twice the CPU time; with 50, 5 us later (H200).
/// So many looks with nothing to see, some 2 ms, before the thread sleeps until it is woken:
/// waking it costs a system call in the program's thread.
constexpr int kLinger = 40;

/// All that were ever started.
std::atomic<PollerThread*> g_threads{nullptr};
std::atomic<bool> g_stops_at_exit{false};

}  // namespace

bool PollerThread::start(std::function<More()> look, std::function<void()> stopped) {
    look_ = std::move(look);
    on_stop_ = std::move(stopped);
    process_ = getpid();
    if (!g_stops_at_exit.exchange(true) && std::atexit(stop_all) != 0) return false;
    if (!start_own_thread(run, this)) return false;
    next_ = g_threads.load();
    while (!g_threads.compare_exchange_weak(next_, this)) {
    }
    return true;
}

void PollerThread::stop_all() {
    for (PollerThread* thread = g_threads.load(); thread; thread = thread->next_) thread->stop();
}

// Waits for the look under way, but not for ever: an exit must come to its end.
void PollerThread::stop() {
    constexpr int kTries = 100;
    constexpr nanoseconds kPause{1'000'000};
    stopped_.store(true);
    if (getpid() != process_) return;  // a forked child: its copy of the lock may be held for good
    SteadyClock clock;
    for (int i = 0; i < kTries; ++i) {
        if (looking_.try_lock()) {
            looking_.unlock();
            break;
        }
        clock.sleep_for(kPause);
    }
    if (on_stop_) on_stop_();
}

More PollerThread::look_unless_stopped() {
    const std::lock_guard lock(looking_);
    return stopped_.load() ? More::kNone : look_();
}

void PollerThread::run(void* self) {
    static_cast<PollerThread*>(self)->look_for_ever();
}

void PollerThread::look_for_ever() {
    const FineTimerSlack slack;
    SteadyClock clock;
    for (int idle = 0;;) {
        const More more = look_unless_stopped();
        idle = more == More::kNone ? idle + 1 : 0;
        if (more != More::kNone && !rests_) {
            sched_yield();
        } else if (idle < kLinger) {
            clock.sleep_for(rest_after(more));
        } else {
            park();
            idle = 0;
        }
    }
}

// A thread that has work for it makes that visible and then reads `parked_`; this thread sets
// `parked_` and then looks for work. Both in one total order, so that one of the two sees the
// other.
void PollerThread::park() {
    parked_.store(1);
    if (look_unless_stopped() != More::kNone) {
        parked_.store(0);
        return;
    }
    while (parked_.load() == 1)
        syscall(SYS_futex, &parked_, FUTEX_WAIT_PRIVATE, 1, nullptr, nullptr, 0);
}

bool PollerThread::wake() {
    if (stopped_.load()) return false;
    if (parked_.load() != 0 && parked_.exchange(0) != 0)
        syscall(SYS_futex, &parked_, FUTEX_WAKE_PRIVATE, 1, nullptr, nullptr, 0);
    return true;
}

}  // namespace urgengo::exec
