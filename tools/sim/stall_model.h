// SPDX-License-Identifier: Apache-2.0
//
// A host that stalls: now and then all threads of the program stand still for a while, as where a
// hypervisor takes the cores away. The GPU goes on, but for rounds of a dispatcher on it, which on
// a GPU would go on as well. Frames that arrive meanwhile pile up.
#pragma once

#include <cstdint>
#include <random>

#include "tools/sim/event_queue.h"

namespace urgengo::sim {

struct StallSettings {
    nanoseconds length{0};  ///< of a stall; 0: there are none
    nanoseconds every{0};   ///< mean time from one's end to the next, exponentially distributed
};

class StallModel {
  public:
    /// @param until  none begins from then on
    StallModel(const StallSettings& settings, nanoseconds until, std::uint32_t seed)
        : settings_(settings), until_(until), random_(seed) {
        plan_next(nanoseconds{0});
    }

    bool is_stalled() const { return is_stalled_; }
    /// @returns when a stall begins, or the one at hand ends; kNever: there is none any more
    nanoseconds next() const { return next_; }
    /// @returns whether that time has come: a stall has begun, or ended
    bool advance(nanoseconds now) {
        if (next_ > now) return false;
        is_stalled_ = !is_stalled_;
        if (is_stalled_)
            next_ += settings_.length;
        else
            plan_next(now);
        return true;
    }

  private:
    void plan_next(nanoseconds now) {
        next_ = kNever;
        if (settings_.length.count() == 0) return;
        std::exponential_distribution<double> gap(1.0 /
                                                  static_cast<double>(settings_.every.count()));
        const nanoseconds begin = now + nanoseconds(static_cast<std::int64_t>(gap(random_)));
        if (begin < until_) next_ = begin;
    }

    const StallSettings settings_;
    const nanoseconds until_;
    std::mt19937_64 random_;
    bool is_stalled_ = false;
    nanoseconds next_{0};
};

}  // namespace urgengo::sim
