// SPDX-License-Identifier: Apache-2.0
#include "tests/support/lockstep.h"

#include <algorithm>
#include <utility>

namespace urgengo::testing {

void Lockstep::add(std::function<void()> body) {
    Thread& its = threads_.emplace_back();
    its.body = std::move(body);
    its.is_over = [] { return true; };
}

void Lockstep::run() {
    for (Thread& its : threads_)
        its.thread = std::thread([this, &its] {
            its.baton.take();
            its.body();
            its.is_over = nullptr;
            hand_on();
        });
    hand_on();
    ended_.take();
    for (Thread& its : threads_) its.thread.join();
    threads_.clear();
}

void Lockstep::wait_for(std::function<bool()> is_over, nanoseconds at_most) {
    Thread& self = *running_;
    self.due = now_ + at_most;
    self.is_over = std::move(is_over);
    if (!hand_on()) self.baton.take();
}

// Nobody but the caller touches anything until the baton is given.
bool Lockstep::hand_on() {
    Thread* const self = running_;
    for (;;) {
        Thread* next = nullptr;
        for (Thread& its : threads_) {
            if (!its.is_over) continue;
            if (its.due > now_ && its.is_over()) its.due = now_;
            if (!next || its.due < next->due) next = &its;
        }
        if (!next) {
            ended_.give();
            return false;
        }
        const auto event = gpu_.next_event();
        now_ = std::max(now_, event ? std::min(*event, next->due) : next->due);
        gpu_.advance_to(now_);
        if (event && *event <= next->due) continue;
        running_ = next;
        if (next == self) return true;
        next->baton.give();
        return false;
    }
}

}  // namespace urgengo::testing
