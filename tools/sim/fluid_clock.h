// SPDX-License-Identifier: Apache-2.0
//
// A resource that all of its users share alike: a clock of the service that each of them has had.
// It advances at the rate that they share, so what a user still needs is known without looking at
// the others, and the first to be done is found in O(log n) however often the rate changes.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "tools/sim/event_queue.h"

namespace urgengo::sim {

class FluidClock {
  public:
    /// @param rate  service for each user in a unit of time, from now on
    void set_rate(double rate) { rate_ = rate; }
    void advance(nanoseconds now) {
        served_ += static_cast<double>((now - now_).count()) * rate_;
        now_ = now;
    }
    /// @param service_ns  that the user needs, from now on
    void add(double service_ns, int user) {
        heap_.push_back({served_ + service_ns, num_added_++, user});
        std::push_heap(heap_.begin(), heap_.end(), later);
    }
    /// @returns when the first user is done, at this rate; kNever if there is none
    nanoseconds next() const {
        if (heap_.empty()) return kNever;
        const double left_ns = std::max(0.0, heap_.front().end - served_);
        return now_ + nanoseconds(static_cast<std::int64_t>(std::ceil(left_ns / rate_)));
    }
    /// @returns whether a user is done
    bool is_due() const { return !heap_.empty() && next() <= now_; }
    int pop() {
        std::pop_heap(heap_.begin(), heap_.end(), later);
        const int user = heap_.back().user;
        heap_.pop_back();
        return user;
    }

  private:
    struct User {
        double end;
        std::uint64_t order;
        int user;
    };
    static bool later(const User& a, const User& b) {
        return a.end != b.end ? a.end > b.end : a.order > b.order;
    }
    nanoseconds now_{0};
    double served_ = 0, rate_ = 1;
    std::vector<User> heap_;
    std::uint64_t num_added_ = 0;
};

}  // namespace urgengo::sim
