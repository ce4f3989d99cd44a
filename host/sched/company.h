// SPDX-License-Identifier: Apache-2.0
//
// Company: whether a task is alone on the GPU, and for how long.
//
// 1 A task is alone while no other is on the GPU.
// 2 After 0.1 s of that no other task looks at it.
// 3 After a second, and two periods of each chain, without another chain no other is expected
//   either: the task is solitary. Chains that take turns without meeting on the GPU are not: the
//   next frame of the other may come at any time.
// 4 A run that is observed only makes no marks, and is on the GPU at any time.
//
// @threads any; a race costs a decision of microseconds
#pragma once

#include <atomic>
#include <chrono>
#include <vector>

#include "host/config/config.h"
#include "urgengo/abi/shared_page.h"

namespace urgengo::sched {

using std::chrono::nanoseconds;

class Company {
  public:
    /// @param page  outlives it
    /// @param start  other tasks may have been there just before
    Company(const abi::SharedPage& page, const std::vector<config::Chain>& chains,
            nanoseconds start);

    /// The chains' periods are others from now on.
    void describe(const std::vector<config::Chain>& chains);

    /// A task of this chain has come to the GPU, and is counted there.
    void came(std::size_t chain, nanoseconds now);
    /// A task has come, or leaves.
    void note(nanoseconds now);
    void unmarked_begins(nanoseconds now);
    void unmarked_ends() { num_unmarked_.fetch_sub(1, kRelaxed); }

    bool has_unmarked() const { return num_unmarked_.load(kRelaxed) != 0; }
    bool is_alone() const { return page_.on_gpu.load(kRelaxed) <= 1; }
    bool no_other_looks(nanoseconds now) const;
    bool is_solitary(nanoseconds now) const {
        return is_alone() && now - others_at_.load(kRelaxed) > solitary_after_.load(kRelaxed);
    }
    /// @returns whether a task that came at `begin` has been alone since
    bool was_alone_since(nanoseconds begin) const;

  private:
    static constexpr auto kRelaxed = std::memory_order_relaxed;
    static constexpr std::size_t kNoChain = static_cast<std::size_t>(-1);

    const abi::SharedPage& page_;
    /// When a task last came to the GPU, or left it, while another was there; at first, the start.
    std::atomic<nanoseconds> shared_at_;
    std::atomic<nanoseconds> others_at_;             ///< the same, or came after another chain
    std::atomic<std::size_t> last_chain_{kNoChain};  ///< whose task came last
    std::atomic<nanoseconds> solitary_after_;
    std::atomic<int> num_unmarked_{0};  ///< runs that are observed only
};

}  // namespace urgengo::sched
