// SPDX-License-Identifier: Apache-2.0
//
// What is to happen when, in virtual time. Events of one moment come in the order in which they
// were put in, so that a run repeats.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <vector>

namespace urgengo::sim {

using std::chrono::nanoseconds;

inline constexpr nanoseconds kNever = nanoseconds::max();

struct Event {
    nanoseconds time{0};
    std::uint64_t order = 0;
    int kind = 0;
    int subject = 0;
};

class EventQueue {
  public:
    void push(nanoseconds time, int kind, int subject) {
        heap_.push_back({time, num_pushed_++, kind, subject});
        std::push_heap(heap_.begin(), heap_.end(), later);
    }
    bool is_empty() const { return heap_.empty(); }
    /// @returns kNever if nothing is to happen
    nanoseconds next() const { return heap_.empty() ? kNever : heap_.front().time; }
    Event pop() {
        std::pop_heap(heap_.begin(), heap_.end(), later);
        const Event event = heap_.back();
        heap_.pop_back();
        return event;
    }

  private:
    static bool later(const Event& a, const Event& b) {
        return a.time != b.time ? a.time > b.time : a.order > b.order;
    }
    std::vector<Event> heap_;
    std::uint64_t num_pushed_ = 0;
};

}  // namespace urgengo::sim
