// SPDX-License-Identifier: Apache-2.0
//
// What time was it on the host's monotonic clock when the GPU's %globaltimer showed a mark's stamp?
//
//  1 Bounds. A mark runs after the host began to launch it and before the host saw it done. So the
//    host time h(g) at which the count became g lies in
//
//        launched - granularity <= h(g) <= seen
//
//    (the count stands still for up to its granularity, so the mark may have run that much after it
//    became g). Nothing else is assumed of queues and polls: a loose pair says little, a tight one
//    much. A mark launched to an idle GPU and waited for is the tightest: 6 us from end to end
//    (measured, H200).
//  2 Intersection. The bounds so far, carried on to the new stamp, and the new bounds must both
//    hold. Carrying on costs: the two clocks run apart at a rate that is known only within limits,
//    so the bounds widen with time until the next tight pair.
//  3 Drift. Every second the bounds are kept as an anchor. The bounds now and those of an anchor
//    limit the mean rate between the two; the anchor that limits it most is used. The rate may have
//    changed since by kWander.
//  4 Granularity. At least kGranularity is allowed for; more if all stamps are multiples of more
//    apart.
//  5 Contradiction. Bounds that do not meet show that an assumption was wrong. By up to
//    kLargestGranularity, the count is taken to be that much coarser, and the drift is learned
//    again. By more, a clock was set or stopped (a suspended virtual machine, a count that began
//    anew): all is forgotten but the last pair.
//
// After one pair everything is known within that pair's bounds. An update takes constant time. Any
// thread may give pairs; one that comes while another is at it goes away. Readers take no lock and
// never wait: they read the newest of four copies.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <optional>

namespace urgengo::model {

using std::chrono::nanoseconds;

/// Stamps carry the low 48 bits of %globaltimer (device_mailbox.h): they wrap every 78 hours.
/// @returns a - b, for stamps less than 39 hours apart
constexpr std::int64_t stamp_difference(std::uint64_t a, std::uint64_t b) {
    return static_cast<std::int64_t>((a - b) << 16) >> 16;
}

class GpuClock {
  public:
    /// CLOCK_MONOTONIC is slewed by at most 500 ppm; crystals differ by less than 100.
    /// @source adjtimex(2)
    static constexpr double kMaxDrift = 600e-6;
    /// How much the rate may change within the anchors' window. Crystals change by less than 1 ppm
    /// a second when they warm up, time daemons correct by a few.
    static constexpr double kWander = 5e-6;
    /// %globaltimer counts in steps of 32 ns on recent GPUs and 1 us on older ones.
    static constexpr nanoseconds kGranularity{1'024};
    static constexpr nanoseconds kLargestGranularity{16'384};

    struct Pair {
        std::uint64_t stamp = 0;  ///< low 48 bits of %globaltimer, written by the mark
        nanoseconds launched{0};  ///< host time before the mark was launched
        nanoseconds seen{0};      ///< host time at which it was first seen to be done
    };
    enum class Update {
        kSkipped,    ///< another thread was at it, or seen < launched
        kRefined,    ///< in line with what was known
        kCoarsened,  ///< contradicted it a little
        kRestarted,  ///< contradicted it, or is the first
    };

    /// @threads any; takes no lock, skips the pair instead of waiting
    Update add(const Pair& pair);

    struct HostTime {
        nanoseconds time{0};
        nanoseconds error{0};  ///< the truth is at most this far away, either way
    };
    /// @returns when the stamp was taken; nothing before the first pair. Stamps from before a
    ///          restart come out wrong: see restarts().
    /// @threads any
    std::optional<HostTime> to_host(std::uint64_t stamp) const;

    /// A stamp, and the host's time when it was taken, as they are known best. Nothing before the
    /// first pair. @threads any
    struct Known {
        std::uint64_t stamp = 0;
        nanoseconds host{0};
    };
    std::optional<Known> newest() const;

    /// @returns by how much the host's clock is slower (negative: faster) than the GPU's, and how
    ///          well that is known, both in ppm
    struct Drift {
        double ppm = 0;
        double error_ppm = 0;
    };
    Drift drift() const;

    /// Counts how often everything was forgotten; 1 after the first pair.
    std::uint32_t restarts() const { return restarts_.load(std::memory_order_acquire); }

  private:
    static constexpr int kAnchors = 8;
    static constexpr std::int64_t kAnchorEvery_ns = 1'000'000'000;
    static constexpr std::uint32_t kCopies = 4;
    static constexpr std::uint32_t kStepsThatTell = 16;

    struct Bounds {
        std::int64_t low_ns = 0, high_ns = 0;
    };
    struct Anchor {
        std::uint64_t stamp = 0;
        Bounds bounds;
    };
    // What readers need. The writer fills the copy after the newest, then says that it is newest.
    struct Copy {
        std::atomic<std::uint64_t> stamp{0};
        std::atomic<std::int64_t> host_ns{0};
        std::atomic<std::int64_t> error_ns{0};
        std::atomic<double> rate{0};
        std::atomic<double> rate_error{0};
    };
    struct Reading {
        std::uint64_t stamp = 0;
        std::int64_t host_ns = 0, error_ns = 0;
        double rate = 0, rate_error = 0;
    };

    Update merge(const Pair& pair);
    Update restart(const Pair& pair);
    void learn_granularity(std::int64_t apart_ns);
    Bounds carried(const Bounds& from, std::int64_t gpu_ns) const;
    void forget_drift();
    void learn_drift();
    void publish();
    std::optional<Reading> read() const;

    std::atomic<bool> busy_{false};
    // Only for the thread that has busy_: h(stamp_) lies within bounds_.
    bool known_ = false;
    std::uint64_t stamp_ = 0;
    Bounds bounds_;
    nanoseconds granularity_ = kGranularity;
    std::int64_t step_ns_ = 0;  // greatest common divisor of what lies between stamps
    std::uint32_t num_steps_ = 0;
    double rate_ = 0;  // host ns per GPU ns, less 1
    double rate_error_ = kMaxDrift;
    std::array<Anchor, kAnchors> anchors_;
    int num_anchors_ = 0;
    int newest_anchor_ = 0;

    std::atomic<std::uint32_t> restarts_{0};
    std::atomic<std::uint32_t> published_{0};
    std::array<Copy, kCopies> copies_;
};

}  // namespace urgengo::model
