// SPDX-License-Identifier: Apache-2.0
//
// How long a task's GPU work really takes, as a factor on what its plan says: estimates prove
// themselves at every instance.
//
//  1 An instance tells two bounds. GPU work cannot have taken longer than the time that there was
//    for it: from each segment's first launch to the end of the wait for it, less what the program
//    was held in between with nothing on the GPU (`most`). And while the thread waited for its
//    work, the GPU was busy with it (`least`): that counts only where no other task was on the GPU.
//  2 So shorter is believed at once, as contention only lengthens: the factor is at most the
//    largest `most / estimated` of the last kRecent instances. (One instance may have skipped
//    work.)
//  3 Longer is believed only where no other task was there, and only as far as each of the last
//    kAlone such instances says: the factor moves halfway to the smallest `least / estimated` of
//    them, at most doubling. (Whatever else delays a thread lengthens a wait, too: a busy core.)
//  4 A factor below 1 that nothing confirms goes back to the plan slowly.
//
//  5 A task that no profile knows has no estimates: its kernels count for a constant. There, what
//    the last kUnknown instances say is all that is known: the factor is their smallest
//    `most / estimated`, as contention only lengthens. But only instances whose thread waited for
//    the GPU during half of that time or more tell: an instance that launches slowly, or works on
//    the CPU before it waits, takes longer than its GPU work.
//
// A profile that is four times too long is corrected after kRecent instances, one that is four
// times too short after a few that had the GPU alone. Where the GPU waits for the program's
// launches, `most` is far above the estimate and `least` far below: neither moves anything.
//
// Pure; the task's owner only.
#pragma once

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>

namespace urgengo::model {

using std::chrono::nanoseconds;

class EstimateFactor {
  public:
    static constexpr std::size_t kRecent = 3, kAlone = 5;
    static constexpr double kLeast = 1.0 / 32, kMost = 32;
    static constexpr std::size_t kUnknown = 16;
    static constexpr double kMostUnknown = 256;

    struct Instance {
        nanoseconds estimated{0};  ///< by the plan, of all that it launched
        nanoseconds most{0};       ///< its GPU work took no longer
        nanoseconds least{0};      ///< nor less, if `alone`
        nanoseconds waited{0};     ///< of `most`: its thread waited, or was held, for the GPU
        bool alone = false;        ///< no other work was on the GPU
    };

    /// An instance whose segments all ended by waits that were seen.
    void observe(const Instance& instance);
    /// The same, of a task without a plan.
    void observe_unknown(const Instance& instance);

    /// @returns what estimates are to be multiplied by, kLeast..kMost
    double value() const { return factor_; }
    /// @returns whether so many instances have told that the estimates may cost a frame its turn
    bool is_supported() const { return instances() >= kRecent; }
    std::uint32_t instances() const { return num_upper_ + num_unknown_; }

  private:
    void observe(const Instance& instance, double most);

    std::array<double, kRecent> upper_{};
    std::array<double, kAlone> lower_{};
    std::array<double, kUnknown> unknown_{};
    std::uint32_t num_upper_ = 0, num_alone_ = 0, num_unknown_ = 0;
    double factor_ = 1;
};

}  // namespace urgengo::model
