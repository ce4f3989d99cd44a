// SPDX-License-Identifier: Apache-2.0
#include "host/sched/bystanders.h"

#include <algorithm>

#include "host/base/memory_orders.h"

namespace urgengo::sched {
namespace {

constexpr float kSlowDownGain = 0.25F;
/// One instance that met something else than the bystander does not tell more than this.
constexpr float kMostSlowDown = 4;
/// Until it is known. Seven traced networks took 28 to 68 us a kernel longer beside matrix products
/// (H200, b71d78a, by priorities alone).
constexpr double kUsualDelay_ns = 50'000;
/// As good as for ever, for a share.
constexpr int kMostWindows = 200;

void add(std::atomic<std::uint32_t>& count, int n) {
    count.store(count.load(kRelaxed) + static_cast<std::uint32_t>(n), kRelaxed);
}

}  // namespace

bool Bystanders::look(nanoseconds now) {
    const int windows = windows_ended(now);
    if (windows == 0) return false;
    const bool launched = launched_->load(kRelaxed);
    if (launched) launched_->store(false, kRelaxed);
    return saw(launched, windows);
}

int Bystanders::windows_ended(nanoseconds now) {
    std::int64_t next = next_ns_.load(kRelaxed);
    if (now.count() < next ||
        !next_ns_.compare_exchange_strong(next, (now + kWindow).count(), kRelaxed))
        return 0;
    const std::int64_t more = next == 0 ? 0 : (now.count() - next) / kWindow.count();
    return 1 + static_cast<int>(std::min<std::int64_t>(more, kMostWindows));
}

// In which of the windows it launched is not known: in one of them.
bool Bystanders::saw(bool launched, int windows) {
    float share = share_.load(kRelaxed);
    for (int i = 1; i < windows; ++i) share -= kGain * share;
    share += kGain * ((launched ? 1.0F : 0.0F) - share);
    share_.store(share, kRelaxed);
    const bool often = share >= (often_.load(kRelaxed) ? kIdle : kBusy);
    often_.store(often, kRelaxed);
    age_.store(std::min(age_.load(kRelaxed) + windows, kStale), kRelaxed);
    // What is known of one that has gone says nothing of the next.
    if (!often) measured_.store(0, kRelaxed);
    const bool was_busy = are_busy(), busy = often && matters();
    busy_.store(busy, kRelaxed);
    add(num_windows_, windows);
    if (often) add(num_often_, windows);
    if (busy) add(num_busy_, windows);
    return busy != was_busy;
}

bool Bystanders::is_known() const {
    return measured_.load(kRelaxed) >= kEnough && age_.load(kRelaxed) < kStale;
}

bool Bystanders::matters() const {
    return !is_known() || slow_down_.load(kRelaxed) >= kSlowed;
}

nanoseconds Bystanders::longer(double kernels) const {
    if (!are_busy()) return nanoseconds{0};
    const double delay_ns = is_known() ? delay_ns_.load(kRelaxed) : kUsualDelay_ns;
    return nanoseconds(static_cast<std::int64_t>(delay_ns * kernels));
}

bool Bystanders::is_long(nanoseconds kernel, float times) const {
    return is_known() && static_cast<float>(kernel.count()) > times * delay_ns_.load(kRelaxed);
}

bool Bystanders::has_time(nanoseconds remaining, nanoseconds laxity) const {
    const float longer = (slow_down_.load(kRelaxed) - 1) * static_cast<float>(remaining.count());
    return static_cast<float>(laxity.count()) >= kSpare * longer;
}

void Bystanders::measured(nanoseconds took, nanoseconds alone, double kernels) {
    if (alone.count() <= 0 || kernels < 1 || !often_.load(kRelaxed)) return;
    const int before = measured_.load(kRelaxed);
    const auto follow = [before](std::atomic<float>& average, float value) {
        const float last = average.load(kRelaxed);
        average.store(before == 0 ? value : last + kSlowDownGain * (value - last), kRelaxed);
    };
    const auto took_ns = static_cast<float>(took.count());
    const auto alone_ns = static_cast<float>(alone.count());
    follow(slow_down_, std::clamp(took_ns / alone_ns, 1.0F, kMostSlowDown));
    follow(delay_ns_, std::max(took_ns - alone_ns, 1.0F) / static_cast<float>(kernels));
    measured_.store(std::min(before + 1, kEnough), kRelaxed);
    age_.store(0, kRelaxed);
}

Bystanders::Counts Bystanders::counts() const {
    return {num_windows_.load(kRelaxed), num_often_.load(kRelaxed), num_busy_.load(kRelaxed)};
}

}  // namespace urgengo::sched
