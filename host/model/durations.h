// SPDX-License-Identifier: Apache-2.0
//
// How long a task's kernels take, learned while it runs from the stamps of its marks.
//
//  1 A span: the launches between two executed marks, n of them, of `measured` GPU time from stamp
//    to stamp, less the mark itself. What one of them took is unknown; the span's time is shared
//    out in proportion to the estimates with which they were launched, e_i:
//
//        sample_i = e_i * measured / (e_1 + ... + e_n)
//
//    As marks fall between other launches in other instances, repeated shares approach each one's
//    own time. (Proportional shares are what multiplicative algebraic reconstruction does with
//    sums over overlapping ranges.)
//  2 A span counts only if the time is the task's own: no other was on the GPU in it, and no
//    launch came so late that the GPU may have waited for it. Otherwise `measured` is an upper
//    bound, and counts only where the estimates exceed it by more than kBoundMargin: clearly too
//    long. (Without the margin, noise would pull estimates to the shortest time ever seen.)
//  3 A moving average (the paper's "averaging recent results", section 4.2.1): the first samples
//    weigh 1, 1/2, 1/3 ..., later ones kGain. An estimate from a profile counts as one sample.
//  4 One instance moves an estimate by at most a factor of kMaxChange. One wild instance (a clock
//    that was throttled, an unseen bystander) then does no more harm than the 30 % of noise
//    that the paper shows the scheduler to stand (its figure on urgency error), and is undone by
//    the next; a profile that is off by two is within a tenth after four. While young (kYoung
//    instances) it may move by kMaxChangeYoung: first instances run with cold caches and lazily
//    loaded code.
//  5 Estimates are kept per position in the instance, and per kernel and size for launches that
//    stand somewhere else than before.
//
// Storage: positions grow in end_instance() only, which is called outside of launches; kernels lie
// in a table of fixed size, allocated at construction. Everything else neither allocates nor locks.
// Owner thread only (TaskState::busy).
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "host/model/launch_log.h"
#include "host/model/task_plan.h"

namespace urgengo::model {

/// Launches [first, end) of the log, between two marks.
struct MeasuredSpan {
    std::uint32_t first = 0, end = 0;
    nanoseconds measured{0};
    bool shared = false;  ///< another task was on the GPU
    bool late = false;    ///< the GPU may have waited for a launch

    /// All of the time was the task's own; else it is an upper bound.
    bool is_own() const { return !shared && !late; }
};

/// An executed mark.
struct StampedMark {
    std::uint32_t sequence = 0;
    std::uint64_t stamp = 0;
    nanoseconds time{0};   ///< the stamp on the host's clock
    nanoseconds error{0};  ///< of that (gpu_clock.h)
};

/// @param from, to   two executed marks of one task
/// @param mark_cost  GPU time that a mark takes, from its stamp on
/// @param shared     another task was on the GPU in between
/// @returns the span, from the first launch on if that came after `from` had run; nothing if there
///          is no launch in it or the log does not reach back
std::optional<MeasuredSpan> span_between(const LaunchLog& log, const StampedMark& from,
                                         const StampedMark& to, nanoseconds mark_cost, bool shared);

/// Whether the profile still says how long the task takes.
struct ProfileFit {
    bool fits = true;
    double ratio = 1;             ///< measured over profiled, in the last instance that told
    std::uint32_t instances = 0;  ///< in a row beyond kMisfitRatio, all to the same side
};

class Durations {
  public:
    static constexpr double kGain = 1.0 / 8;
    static constexpr double kMaxChange = 1.25;
    static constexpr double kMaxChangeYoung = 2;
    static constexpr std::uint32_t kYoung = 4;
    static constexpr double kBoundMargin = 1.15;
    /// Up to 30 % of error change little (paper, figure on urgency error); for so many instances in
    /// a row it is not noise.
    static constexpr double kMisfitRatio = 1.3;
    static constexpr std::uint32_t kMisfitInstances = 8;
    static constexpr std::size_t kMaxPositions = 65'536;
    static constexpr std::size_t kMaxKernels = 512;  ///< power of two
    /// A position takes another kernel for its own when it has stood there so often in a row.
    static constexpr std::uint8_t kMaxStrangers = 3;

    struct Planned {
        std::uint64_t kernel = 0;
        nanoseconds gpu_time{0};
    };

    /// @param profile  in order of position; empty for a task that was never profiled
    explicit Durations(std::span<const Planned> profile = {});

    /// @returns the estimate for this launch; nothing if neither a profile nor a measurement has
    ///          told anything of it
    std::optional<nanoseconds> find(std::uint32_t position, std::uint64_t kernel) const;

    /// Learns from a span. Does not allocate.
    void observe(const LaunchLog& log, const MeasuredSpan& span);

    /// Ends an instance of so many launches: brings remaining_from() up to date, makes room for
    /// positions that are new. Allocates; never called in a launch.
    void end_instance(std::uint32_t num_launches);

    /// @returns estimated GPU time of the launches from `position` on, as of the last instance's
    /// end
    nanoseconds remaining_from(std::size_t position) const {
        return position < remaining_.size() ? remaining_[position] : nanoseconds{0};
    }
    /// Launches that remaining_from() counts on: the profile's, else the last instance's.
    std::size_t num_launches() const { return remaining_.size(); }

    ProfileFit profile_fit() const { return fit_; }

  private:
    struct Estimate {
        std::uint64_t kernel = 0;  // 0: none
        double ns = 0;
        double ns_at_begin = 0;       // of the instance in which it was last measured
        std::uint32_t instance = 0;   // its number
        std::uint32_t instances = 0;  // in which it was measured
        std::uint32_t samples = 0;    // a profile counts as one
        std::uint32_t last_span = 0;  // that it learned from
        bool is_bound = false;        // all that is known is that it takes no longer
    };
    struct Place {
        Estimate estimate;
        double profiled_ns = 0;  // 0: not in the profile
        std::uint64_t stranger = 0;
        std::uint8_t strangers = 0;
    };

    void learn(Estimate& estimate, double sample_ns, bool is_own);
    Estimate* kernel_slot(std::uint64_t kernel, bool add);
    const Estimate* find_kernel(std::uint64_t kernel) const;
    Place* place_of(const LoggedLaunch& launch);
    void judge_profile();
    void sum_up(std::size_t num_launches);

    std::vector<Place> places_;
    std::vector<Estimate> kernels_;  // shape [kMaxKernels], open addressing; never removed from
    std::size_t num_kernels_ = 0;
    std::vector<nanoseconds> remaining_;
    std::size_t num_profiled_ = 0;
    std::uint32_t instance_ = 1;
    std::uint32_t span_ = 0;
    // Of this instance's own spans, as far as they are in the profile:
    double measured_ns_ = 0, profiled_ns_ = 0;
    int side_ = 0;  // of the instances that did not fit: +1 longer, -1 shorter
    ProfileFit fit_;
};

}  // namespace urgengo::model
