// SPDX-License-Identifier: Apache-2.0
//
// Counts of times, in bins that are at most 3 % wide: small enough for one in every thread and kind
// of call, and written by one thread without a lock, read by any.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace urgengo::own_time {

class Histogram {
  public:
    /// @threads one
    void add(std::uint64_t value) {
        bump(bins_[bin_of(value)], 1);
        bump(sum_, value);
        if (value > max_.load(kRelaxed)) max_.store(value, kRelaxed);
    }

    /// @threads one, for `this`; what the other's thread adds meanwhile may be in it or not
    void merge(const Histogram& other) {
        for (std::size_t i = 0; i < kBins; ++i) bump(bins_[i], other.bins_[i].load(kRelaxed));
        bump(sum_, other.sum_.load(kRelaxed));
        max_.store(std::max(max(), other.max()), kRelaxed);
    }

    std::uint64_t count() const {
        std::uint64_t count = 0;
        for (const auto& bin : bins_) count += bin.load(kRelaxed);
        return count;
    }
    std::uint64_t max() const { return max_.load(kRelaxed); }
    /// Exact. 0 of no values.
    double mean() const {
        const std::uint64_t values = count();
        return values ? static_cast<double>(sum_.load(kRelaxed)) / static_cast<double>(values) : 0;
    }
    /// The middle of the bin of the smallest value that `share` of all values do not exceed; never
    /// more than the largest. 0 of no values.
    double percentile(double share) const {
        // Less a hair, so that 0.99 of 100 values is the 99th.
        const double rank = std::max(1.0, std::ceil(share * static_cast<double>(count()) - 1e-6));
        std::uint64_t below = 0;
        for (std::size_t i = 0; i < kBins; ++i) {
            below += bins_[i].load(kRelaxed);
            if (static_cast<double>(below) >= rank)
                return std::min(middle_of(i), static_cast<double>(max()));
        }
        return 0;
    }

    /// @param use  of (the middle, the count) of each bin that has any, in order
    template <typename Use>
    void each_bin(Use&& use) const {
        for (std::size_t i = 0; i < kBins; ++i)
            if (const std::uint64_t values = bins_[i].load(kRelaxed)) use(middle_of(i), values);
    }

  private:
    static constexpr auto kRelaxed = std::memory_order_relaxed;
    /// 32 bins for each doubling; values below that have one each.
    static constexpr int kBits = 5;
    static constexpr std::size_t kInDoubling = std::size_t{1} << kBits;
    static constexpr int kMaxBits = 44;  ///< of ticks: more than an hour
    static constexpr std::size_t kBins = (kMaxBits - kBits + 1) * kInDoubling;

    static std::size_t bin_of(std::uint64_t value) {
        if (value < kInDoubling) return static_cast<std::size_t>(value);
        const int shift = std::bit_width(value) - 1 - kBits;
        const auto bin = static_cast<std::size_t>(shift) * kInDoubling +
                         static_cast<std::size_t>(value >> shift);
        return std::min(bin, kBins - 1);
    }
    static double middle_of(std::size_t bin) {
        if (bin < kInDoubling) return static_cast<double>(bin);
        const std::size_t shift = bin / kInDoubling - 1;
        const std::size_t first = (bin - shift * kInDoubling) << shift;
        return static_cast<double>(first) + 0.5 * std::ldexp(1.0, static_cast<int>(shift)) - 0.5;
    }

    static void bump(std::atomic<std::uint64_t>& count, std::uint64_t by) {
        count.store(count.load(kRelaxed) + by, kRelaxed);
    }

    std::array<std::atomic<std::uint64_t>, kBins> bins_{};
    std::atomic<std::uint64_t> sum_{0}, max_{0};
};

}  // namespace urgengo::own_time
