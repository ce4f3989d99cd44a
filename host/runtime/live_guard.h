// SPDX-License-Identifier: Apache-2.0
//
// The guard (sched/guard.h) among threads. A thread that begins or ends a frame tells it, if no
// other does just then: else that frame does not count. What it has chosen is a byte a chain, which
// launches read.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "host/config/config.h"
#include "host/sched/guard.h"

namespace urgengo::runtime {

class LiveGuard {
  public:
    explicit LiveGuard(const config::Config& config);
    /// Before there are threads. @param told  what it gives a chain from then on; takes no lock
    void tell(std::function<void(std::size_t chain, sched::GuardMode mode)> told) {
        told_ = std::move(told);
    }

    bool is_on() const { return is_on_; }
    /// @threads any
    sched::GuardMode mode(std::size_t chain) const {
        return modes_[chain].load(std::memory_order_relaxed);
    }
    bool enforces(std::size_t chain) const { return mode(chain) == sched::GuardMode::kEnforce; }
    bool observes(std::size_t chain) const { return mode(chain) == sched::GuardMode::kObserve; }

    /// @threads any; the program's, once a frame
    void frame_began(std::size_t chain, std::chrono::nanoseconds arrival);
    struct Surroundings {
        bool beside_bystander = false;  ///< work of no chain keeps the GPU busy
        bool nobody_is_held = false;    ///< as launching is scarce
    };
    /// Says in a line, once, that chains have fallen back.
    /// @returns whether some chain's mode has changed
    bool frame_ended(std::size_t chain, std::chrono::nanoseconds latency,
                     const Surroundings& surroundings, std::chrono::nanoseconds now);
    /// UrgenGo has been switched off, or on: what was being compared means nothing.
    void pause();

    /// The chain's period or deadline is another one from now on.
    void describe(std::size_t chain, std::chrono::nanoseconds period,
                  std::chrono::nanoseconds deadline);

    /// What others than the guard have found out of the chain's estimates.
    void estimates_contradict(std::size_t chain, bool they_do);

    // At exit, perhaps out of a signal's handler: they say nothing rather than wait for a thread.
    /// What it has made of each chain, in a word; "off" if it is.
    std::vector<const char*> words();
    /// @returns what it has made of each chain, and has found of it last
    std::vector<sched::GuardedChain> found();
    /// One line, for people; empty if it has never found reason to compare, or is off.
    std::string summary();
    bool has_fallen_back();

    /// For tests: the guard as another thread has it that is in one of these calls.
    std::unique_lock<std::mutex> take() { return std::unique_lock(mutex_); }

  private:
    void publish();
    void pause_if_asked();
    std::string say() const;
    void note_modes() const;  ///< for our own log

    const bool is_on_;
    std::vector<std::string> names_;
    std::vector<std::chrono::nanoseconds> deadlines_;
    std::mutex mutex_;
    sched::Guard guard_;  ///< under mutex_
    bool has_said_ = false;
    std::atomic<bool> must_pause_{false};         ///< as soon as a thread has the mutex
    std::vector<std::atomic<bool>> contradicts_;  ///< as the guard was told, by chain
    std::vector<std::atomic<sched::GuardMode>> modes_;
    std::function<void(std::size_t chain, sched::GuardMode mode)> told_;
};

}  // namespace urgengo::runtime
