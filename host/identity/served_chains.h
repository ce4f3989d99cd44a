// SPDX-License-Identifier: Apache-2.0
//
// Which chains a thread works for: those of whose instances it has begun one lately. A thread that
// serves several holds all of them up when it is held; one that served another long ago (a pool's
// thread, say) does not. The thread's own.
#pragma once

#include <chrono>
#include <cstddef>
#include <vector>

#include "host/model/task_set.h"

namespace urgengo::identity {

class ServedChains {
  public:
    using nanoseconds = std::chrono::nanoseconds;

    /// A thread that has begun nothing of a chain for so many of its periods serves it no more.
    static constexpr int kPeriods = 4;

    /// @param chain  its index
    void serve(int chain, nanoseconds now) {
        const auto i = static_cast<std::size_t>(chain);
        if (times_.size() <= i) times_.resize(i + 1);  // at the first one only
        times_[i] = now;
        chains_.insert(chain);
    }

    /// Calls act(chain) for each that it serves now.
    /// @param period_of  (int chain) -> nanoseconds
    template <typename PeriodOf, typename Act>
    void for_each(nanoseconds now, PeriodOf&& period_of, Act&& act) {
        const model::TaskSet before = chains_;
        before.for_each([&](int chain) {
            if (now - times_[static_cast<std::size_t>(chain)] > kPeriods * period_of(chain))
                chains_.erase(chain);
            else
                act(chain);
        });
    }

  private:
    model::TaskSet chains_;
    std::vector<nanoseconds> times_;  ///< of the last instance, by chain
};

}  // namespace urgengo::identity
