// SPDX-License-Identifier: Apache-2.0
#include "host/model/gpu_clock.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "host/base/memory_orders.h"

namespace urgengo::model {
namespace {

std::int64_t rounded_up(double ns) {
    return static_cast<std::int64_t>(std::ceil(ns));
}

}  // namespace

GpuClock::Update GpuClock::add(const Pair& pair) {
    if (pair.seen < pair.launched) return Update::kSkipped;
    if (busy_.exchange(true, kAcquire)) return Update::kSkipped;
    const Update update = merge(pair);
    learn_drift();
    publish();
    busy_.store(false, kRelease);
    return update;
}

GpuClock::Update GpuClock::merge(const Pair& pair) {
    if (!known_) return restart(pair);
    const std::int64_t later_ns = stamp_difference(pair.stamp, stamp_);
    learn_granularity(std::abs(later_ns));
    Bounds fresh{(pair.launched - granularity_).count(), pair.seen.count()};
    // Marks of two streams may be seen out of order; bounds are never carried back.
    if (later_ns >= 0) {
        bounds_ = carried(bounds_, later_ns);
        stamp_ = pair.stamp;
    } else {
        fresh = carried(fresh, -later_ns);
    }
    bounds_ = {std::max(bounds_.low_ns, fresh.low_ns), std::min(bounds_.high_ns, fresh.high_ns)};
    const std::int64_t gap_ns = bounds_.low_ns - bounds_.high_ns;
    if (gap_ns <= 0) return Update::kRefined;
    if (gap_ns > kLargestGranularity.count()) return restart(pair);
    // Either may be wrong: what lies between them is as good as both.
    bounds_ = {bounds_.high_ns, bounds_.low_ns};
    granularity_ = std::min(granularity_ + nanoseconds(gap_ns), kLargestGranularity);
    forget_drift();
    return Update::kCoarsened;
}

GpuClock::Update GpuClock::restart(const Pair& pair) {
    known_ = true;
    stamp_ = pair.stamp;
    granularity_ = kGranularity;
    step_ns_ = 0;
    num_steps_ = 0;
    bounds_ = {(pair.launched - granularity_).count(), pair.seen.count()};
    forget_drift();
    restarts_.fetch_add(1, kRelease);
    return Update::kRestarted;
}

void GpuClock::learn_granularity(std::int64_t apart_ns) {
    if (apart_ns == 0) return;
    step_ns_ = std::gcd(step_ns_, apart_ns);
    if (++num_steps_ < kStepsThatTell) return;
    num_steps_ = kStepsThatTell;
    const nanoseconds step(step_ns_);
    if (step <= granularity_ || step > kLargestGranularity) return;
    bounds_.low_ns -= (step - granularity_).count();  // lower bounds so far allowed for too little
    granularity_ = step;
    forget_drift();
}

GpuClock::Bounds GpuClock::carried(const Bounds& from, std::int64_t gpu_ns) const {
    const double gpu = static_cast<double>(gpu_ns);
    return {from.low_ns + gpu_ns - rounded_up(gpu * (rate_error_ - rate_)),
            from.high_ns + gpu_ns + rounded_up(gpu * (rate_error_ + rate_))};
}

void GpuClock::forget_drift() {
    num_anchors_ = 0;
    rate_ = 0;
    rate_error_ = kMaxDrift;
}

void GpuClock::learn_drift() {
    const auto add_anchor = [&] {
        newest_anchor_ = (newest_anchor_ + 1) % kAnchors;
        num_anchors_ = std::min(num_anchors_ + 1, kAnchors);
        anchors_[static_cast<std::size_t>(newest_anchor_)] = {stamp_, bounds_};
    };
    if (num_anchors_ == 0) return add_anchor();

    double best_low = -kMaxDrift, best_high = kMaxDrift;
    for (int i = 0; i < num_anchors_; ++i) {
        const int index = (newest_anchor_ - i + kAnchors) % kAnchors;
        const Anchor& anchor = anchors_[static_cast<std::size_t>(index)];
        const std::int64_t since_ns = stamp_difference(stamp_, anchor.stamp);
        if (since_ns <= 0) continue;
        const auto rate = [&](std::int64_t host_ns) {
            return static_cast<double>(host_ns - since_ns) / static_cast<double>(since_ns);
        };
        const double low = rate(bounds_.low_ns - anchor.bounds.high_ns);
        const double high = rate(bounds_.high_ns - anchor.bounds.low_ns);
        if (high < -kMaxDrift || low > kMaxDrift) return forget_drift();
        if (high - low < best_high - best_low) {
            best_low = std::max(low, -kMaxDrift);
            best_high = std::min(high, kMaxDrift);
        }
    }
    rate_ = (best_low + best_high) / 2;
    rate_error_ = std::min((best_high - best_low) / 2 + kWander, kMaxDrift + std::abs(rate_));
    const Anchor& newest = anchors_[static_cast<std::size_t>(newest_anchor_)];
    if (stamp_difference(stamp_, newest.stamp) >= kAnchorEvery_ns) add_anchor();
}

// A reader that sees anything of a later write to its copy acquires with it that `published_` has
// moved on by three or more, and reads again.
void GpuClock::publish() {
    const std::uint32_t next = published_.load(kRelaxed) + 1;
    Copy& copy = copies_[next % kCopies];
    const std::int64_t width_ns = bounds_.high_ns - bounds_.low_ns + granularity_.count();
    copy.stamp.store(stamp_, kRelease);
    copy.host_ns.store(bounds_.low_ns + width_ns / 2, kRelease);
    copy.error_ns.store((width_ns + 1) / 2, kRelease);
    copy.rate.store(rate_, kRelease);
    copy.rate_error.store(rate_error_, kRelease);
    published_.store(next, kRelease);
}

std::optional<GpuClock::Reading> GpuClock::read() const {
    for (int attempt = 0; attempt < 4; ++attempt) {
        const std::uint32_t newest = published_.load(kAcquire);
        if (newest == 0) return std::nullopt;
        const Copy& copy = copies_[newest % kCopies];
        const Reading reading{copy.stamp.load(kAcquire), copy.host_ns.load(kAcquire),
                              copy.error_ns.load(kAcquire), copy.rate.load(kAcquire),
                              copy.rate_error.load(kAcquire)};
        if (published_.load(kRelaxed) - newest < kCopies - 1) return reading;
    }
    return std::nullopt;
}

std::optional<GpuClock::HostTime> GpuClock::to_host(std::uint64_t stamp) const {
    const auto r = read();
    if (!r) return std::nullopt;
    const std::int64_t since_ns = stamp_difference(stamp, r->stamp);
    const double since = static_cast<double>(since_ns);
    return HostTime{nanoseconds(r->host_ns + since_ns + static_cast<std::int64_t>(since * r->rate)),
                    nanoseconds(r->error_ns + rounded_up(std::abs(since) * r->rate_error))};
}

std::optional<GpuClock::Known> GpuClock::newest() const {
    const auto r = read();
    if (!r) return std::nullopt;
    return Known{r->stamp, nanoseconds(r->host_ns)};
}

GpuClock::Drift GpuClock::drift() const {
    const auto r = read();
    return r ? Drift{r->rate * 1e6, r->rate_error * 1e6} : Drift{0, kMaxDrift * 1e6};
}

}  // namespace urgengo::model
