// SPDX-License-Identifier: Apache-2.0
//
// Threads in virtual time beside the simulated GPU's engine, one at a time: who sleeps or waits for
// the GPU hands the baton to the thread that is due first, and the time and the GPU go on to then.
// So a program that is run twice does the same twice, whatever the machine and its load.
//
// Ties: what the GPU does at a moment comes before what threads do, then the thread that was added
// first. Between two sleeps a thread takes no time.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <list>
#include <mutex>
#include <thread>

#include "host/base/clock.h"
#include "tools/simgpu/engine/engine.h"

namespace urgengo::testing {

class Lockstep final : public Clock {
  public:
    static constexpr nanoseconds kStart{1'000'000'000};

    explicit Lockstep(simgpu::Engine& gpu) : gpu_(gpu) { gpu.advance_to(kStart); }
    Lockstep(const Lockstep&) = delete;
    Lockstep& operator=(const Lockstep&) = delete;

    /// @param body  what the thread does: from kStart on, in run()
    void add(std::function<void()> body);
    /// @returns when all threads have ended
    void run();

    // In the threads; now() also in what the engine calls.
    nanoseconds now() override { return now_; }
    void sleep_for(nanoseconds duration) override {
        wait_for([] { return false; }, duration);
    }
    /// Until the GPU, or another thread, has brought it about.
    /// @param at_most  for so long
    void wait_for(std::function<bool()> is_over, nanoseconds at_most = std::chrono::hours(1));

  private:
    // (std::binary_semaphore sleeps for ever at times: GCC bug 104928.)
    class Baton {
      public:
        void give() {
            const std::lock_guard lock(mutex_);
            is_here_ = true;
            given_.notify_one();
        }
        void take() {
            std::unique_lock lock(mutex_);
            given_.wait(lock, [this] { return is_here_; });
            is_here_ = false;
        }

      private:
        std::mutex mutex_;
        std::condition_variable given_;
        bool is_here_ = false;
    };
    struct Thread {
        std::function<void()> body;
        nanoseconds due{kStart};
        std::function<bool()> is_over{};  ///< then it is due at once; empty: it has ended
        Baton baton{};
        std::thread thread{};
    };

    bool hand_on();  ///< @returns whether the calling thread goes on

    simgpu::Engine& gpu_;
    nanoseconds now_{kStart};
    std::list<Thread> threads_;
    Thread* running_ = nullptr;
    Baton ended_;
};

}  // namespace urgengo::testing
