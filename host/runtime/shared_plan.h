// SPDX-License-Identifier: Apache-2.0
//
// What the policy `feasible` has planned last, for all threads. One of them at a time makes a plan,
// in scratch that is the plan's: a program's stack may have 16 KiB, and a plan takes more.
//
// The one that makes it is told by its thread pointer: a program may jump out of our frames
// (siglongjmp), and then that thread itself gives the plan back when it comes again (recovery.cpp).
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <vector>

#include "host/sched/policies/feasible.h"
#include "host/sched/snapshot.h"

namespace urgengo::runtime {

using std::chrono::nanoseconds;

struct SharedPlan {
    /// @param most  instances that there can be: one a task, and the next one of each chain
    explicit SharedPlan(std::size_t most) : scratch(most) { views.reserve(most); }

    std::atomic<std::uint32_t> changes{0};
    std::atomic<std::uint32_t> needed{0};    ///< counts plan_is_needed()
    std::atomic<std::uint32_t> made_for{0};  ///< `needed` before it was made
    std::atomic<nanoseconds> time{nanoseconds{-1'000'000'000}};
    model::SharedTaskSet given_up, late_first, may_share;
    std::atomic<nanoseconds> slack{nanoseconds{0}};
    std::atomic<nanoseconds> cost{nanoseconds{0}};  ///< what making it took
    // Whoever makes a plan only:
    std::vector<model::SlotView> views;
    sched::PlanScratch scratch;

    sched::Plan read() const {
        return {given_up.load(), late_first.load(), may_share.load(),
                slack.load(std::memory_order_relaxed)};
    }

    /// @returns whether this thread makes a plan now; then release() is due
    bool take() {
        void* nobody = nullptr;
        return maker_.compare_exchange_strong(nobody, __builtin_thread_pointer(),
                                              std::memory_order_acquire);
    }
    void release() { maker_.store(nullptr, std::memory_order_release); }
    /// The calling thread is not at it any more, if it ever was.
    void release_if_own() {
        if (maker_.load(std::memory_order_relaxed) == __builtin_thread_pointer()) release();
    }

  private:
    std::atomic<void*> maker_{nullptr};  ///< null: nobody
};

}  // namespace urgengo::runtime
