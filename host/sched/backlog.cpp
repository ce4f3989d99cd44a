// SPDX-License-Identifier: Apache-2.0
#include "host/sched/backlog.h"

#include <algorithm>

namespace urgengo::sched {
namespace {

/// Of a period: arrivals vary by less.
constexpr int kJitter = 4;
/// A thread off the CPU for less than this part of a period may have been kept from it, where
/// frames wait for it.
constexpr int kPreempted = 4;
/// That frames are left out is believed after so many times; that only one is kept, too.
constexpr int kSure = 2, kMostSure = 6;
/// A frame arrives later than the one before, by this at least.
constexpr nanoseconds kApart{1};
/// So many frames in a row far behind are taken for it, as well.
constexpr int kFarBehind = 16;

}  // namespace

nanoseconds Backlog::begin_frame(const GovernedChain& chain, nanoseconds end, nanoseconds cpu,
                                 nanoseconds now) {
    const nanoseconds last(chain.last_arrival_ns.load(std::memory_order_relaxed));
    const nanoseconds period = chain.period();
    // Another thread served the chain meanwhile, or this one another chain.
    if (last != last_ || period_ != period) *this = {};
    period_ = period;
    const nanoseconds begin = end.count() == 0 ? now : now - cpu;
    nanoseconds arrival = begin;
    if (anchor_.count() == 0) anchor_ = last_begin_ = last;
    if (end.count() == 0 || last.count() == 0 || is_sure(begin, end)) {
        caught_up(begin, end);
    } else {
        // Not by more than makes a difference.
        const nanoseconds oldest = now - 2 * chain.longest();
        arrival = std::min(begin, std::max(behind(begin, oldest), oldest));
    }
    if (last.count() != 0) arrival = std::max(arrival, last + kApart);
    last_ = arrival;
    last_begin_ = begin;
    return arrival;
}

bool Backlog::is_sure(nanoseconds begin, nanoseconds end) const {
    // More than have come since the anchor cannot be: it was too late.
    if (come_at_most(begin) <= begun_) return true;
    const nanoseconds last_due = anchor_ + begun_ * period_;
    const bool was_in_time = last_begin_ - last_due <= period_ / kJitter;
    if (was_in_time && end <= last_due + period_) return true;
    const bool waits_for_it = come(begin) > begun_ + 1;
    return begin - end > (waits_for_it ? std::max(kNotAsleep, period_ / kPreempted) : kNotAsleep);
}

std::int64_t Backlog::come_at_most(nanoseconds time) const {
    return come(time + period_ / kJitter);
}

void Backlog::caught_up(nanoseconds arrival, nanoseconds end) {
    if (begun_ > 0 && was_behind_) {
        const bool left_out = come(end - period_ / kJitter) > begun_;
        left_out_ = std::clamp(left_out_ + (left_out ? 1 : -1), 0, kMostSure);
        for (Count& c : counts_)
            if (c.refuted_now || left_out)
                c.refuted = std::clamp(c.refuted + (c.refuted_now ? 1 : -1), 0, kMostRefuted);
    }
    anchor_ = arrival;
    begun_ = 0;
    far_behind_ = 0;
    was_behind_ = false;
    for (Count& c : counts_) c.frame = 0, c.refuted_now = false;
}

nanoseconds Backlog::behind(nanoseconds begin, nanoseconds oldest) {
    ++begun_;
    was_behind_ |= come(begin) > begun_;
    for (std::size_t i = 0; i < kMostKept; ++i) {
        Count& c = counts_[i];
        if (c.frame + 1 > come_at_most(begin)) c.refuted_now = true;
        c.frame = std::max(c.frame + 1, come(begin) - static_cast<std::int64_t>(i));
    }
    const nanoseconds of_all = anchor_ + begun_ * period_;
    far_behind_ = of_all < oldest ? std::min(far_behind_ + 1, kFarBehind) : 0;
    const std::size_t kept = leaves_out() ? num_kept() : 0;
    return kept == 0 ? of_all : anchor_ + counts_[kept - 1].frame * period_;
}

bool Backlog::leaves_out() const {
    return left_out_ >= kSure || far_behind_ >= kFarBehind;
}

/// @returns 0: more than are played
std::size_t Backlog::num_kept() const {
    const bool may_be_one = left_out_ > kSure && counts_[0].refuted == 0;
    for (std::size_t i = may_be_one ? 0 : 1; i < kMostKept; ++i)
        if (!counts_[i].is_too_small()) return i + 1;
    return 0;
}

}  // namespace urgengo::sched
