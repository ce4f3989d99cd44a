// SPDX-License-Identifier: Apache-2.0
//
// A thread that does one thing for as long as this object lives.
#pragma once

#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <future>
#include <mutex>
#include <thread>

#include "host/base/thread_wait.h"

namespace urgengo::testing {

/// Waits until the system knows the thread no more. A join returns before that: at the time at
/// which the thread's stack is free.
inline void wait_until_gone(int id) {
    for (int i = 0; i < 10'000 && tgkill(getpid(), id, 0) == 0; ++i)
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

class OtherThread {
  public:
    enum class Does { kSpin, kSleep, kWaitForLock };

    explicit OtherThread(Does does)
        : lock_(mutex_), thread_([this, does] {
              id_.set_value(gettid());
              while (!ends_) act(does);
          }) {
        number_ = id_.get_future().get();
        // It may not have come so far yet. If it never seems to, the test says so.
        for (int i = 0; i < 1000 && !does_it(does); ++i)
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    OtherThread(const OtherThread&) = delete;
    OtherThread& operator=(const OtherThread&) = delete;
    ~OtherThread() {
        ends_ = true;
        lock_.unlock();
        thread_.join();
    }
    /// Of the operating system.
    int id() const { return number_; }

  private:
    bool does_it(Does does) const {
        return what_waits_for(number_).what ==
               (does == Does::kWaitForLock ? ThreadWait::For::kMutex : ThreadWait::For::kNothing);
    }
    void act(Does does) {
        if (does == Does::kSleep) std::this_thread::sleep_for(std::chrono::milliseconds(20));
        if (does == Does::kWaitForLock) const std::lock_guard waits(mutex_);
    }

    std::atomic<bool> ends_ = false;
    std::mutex mutex_;
    std::unique_lock<std::mutex> lock_;
    std::promise<int> id_;
    std::thread thread_;
    int number_ = 0;
};

}  // namespace urgengo::testing
