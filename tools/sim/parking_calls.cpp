// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/parking_calls.h"

#include <algorithm>

namespace urgengo::sim {
namespace {

/// From the end of GPU work to when the thread that waits for it knows. @source H200 (world.cpp)
constexpr nanoseconds kEndSeen{3'200};

}  // namespace

nanoseconds ParkingCalls::next() const {
    if (state_ == State::kWaiting) return kNever;
    return state_ == State::kAsleep && next_ >= until_ ? kNever : next_;
}

void ParkingCalls::advance(nanoseconds now) {
    if (next() <= now) {
        if (state_ == State::kAsleep) {
            called_ = now;
            // Gates open before the call is made: it waits for what was behind them, too.
            subject_.park_begins(now);
            awaited_.clear();
            for (int stream = 0; stream < gpu_.num_streams(); ++stream)
                awaited_.push_back(gpu_.launched(stream));
            state_ = State::kWaiting;
        } else {
            subject_.park_ends(now);
            next_ = std::max(called_ + every_, now);
            state_ = State::kAsleep;
        }
    }
    if (state_ != State::kWaiting || !has_ended()) return;
    state_ = State::kSeeing;
    next_ = now + kEndSeen;
}

bool ParkingCalls::has_ended() const {
    for (std::size_t stream = 0; stream < awaited_.size(); ++stream)
        if (gpu_.ended(static_cast<int>(stream)) < awaited_[stream]) return false;
    return true;
}

}  // namespace urgengo::sim
