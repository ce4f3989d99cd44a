// SPDX-License-Identifier: Apache-2.0
//
// Why a frame was late: one cause, from what was measured of the frame and of the others meanwhile.
//
// 1 What went otherwise than it should is summed up in times: how much later than it should its
//   first task began, how much longer than profiled the CPU took and its own kernels did, for how
//   long its launches were held behind another chain, and what the work of others that was on the
//   GPU meanwhile took from it.
// 2 The largest of these is the cause, if it is a fair part of the lateness. So a frame that was
//   late by 3 ms, was held for 10 and computed for 4 longer was late because it was held.
// 3 What a GPU segment takes beyond its plan is its own as far as its kernels are known to take
//   longer by themselves. The rest is that of others, as far as they had work on the GPU meanwhile,
//   and then its own. The others share it by what each takes: of work that goes before it, all that
//   was on the GPU; of work that goes behind it one kernel, as a kernel cannot be interrupted, and
//   all if it had the same priority or a greater one; and of both as much as the two do not fit
//   beside each other. (By CUPTI's records of ten chains on an H200, all of 23 frames whose rest
//   was taken for their own had lost it to others.)
// 4 An instance that was given up went behind the others, because it was given up. Its own times
//   come before that: they are why it was.
//
// Pure: no clock, no thread.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "host/sched/given_up.h"
#include "urgengo/abi/status_page.h"

namespace urgengo::observe {

using abi::MissCause;
using std::chrono::nanoseconds;

/// Time by chain: of the few that took most, however small the pieces are that it comes in. A chain
/// that takes another one's place begins with its time (Space-Saving: Metwally, Agrawal, El Abbadi,
/// 2005), so that pieces add up, and is told without it.
class TimeBehind {
  public:
    static constexpr std::size_t kMost = 4;

    struct Entry {
        int chain = -1;  ///< -1: work of no chain, or not known whose
        nanoseconds time{0};
    };
    void add(int chain, nanoseconds time);
    void add(const TimeBehind& other);
    /// @returns the chain with the longest time that is its own for sure
    Entry longest() const;
    nanoseconds total() const { return total_; }

  private:
    struct Kept : Entry {
        nanoseconds before{0};  ///< of `time`, what was another chain's
        Entry own() const { return {chain, time - before}; }
    };
    std::array<Kept, kMost> entries_{};  // those without time are free
    nanoseconds total_{0};
};

/// A GPU segment: from its first launch to the end of the wait for it.
struct GpuWindow {
    nanoseconds begin{0}, end{0};
    nanoseconds gpu{0};       ///< that its kernels take by the plan, as corrected
    nanoseconds deadline{0};  ///< of its instance
    double utilization = 1;   ///< of the GPU, by its kernels, 0..1
    nanoseconds longest_kernel{0};
    /// Of its launches, as the driver takes them: the smallest goes first.
    int first_priority = 0, last_priority = 0;
};

/// @returns for how long both are on the GPU
nanoseconds overlap(const GpuWindow& a, const GpuWindow& b);

/// @returns how much work of the other one is on the GPU beside this one, if it is spread evenly
nanoseconds work_beside(const GpuWindow& other, const GpuWindow& own);

/// What another segment takes from one.
struct Taken {
    nanoseconds by_urgent{0};    ///< it goes before
    nanoseconds by_kernel{0};    ///< it goes behind, but its kernel could not be interrupted
    nanoseconds by_priority{0};  ///< it should go behind, but had the priority to go before
};
Taken taken_by(const GpuWindow& other, const GpuWindow& own);

/// All that is known of a frame, at its end.
struct FrameFacts {
    nanoseconds deadline{0}, latency{0};
    bool was_off = false;  ///< UrgenGo did not schedule it, all the time or for a part of it
    /// Its program was told to end it, as it would have been late by that even alone.
    std::optional<nanoseconds> exited;
    std::optional<sched::GivenUp> given_up;
    bool beside_bystanders = false;  ///< work of no chain was on the GPU
    nanoseconds began_late{0};       ///< beyond what is usual, after its arrival
    nanoseconds cpu_longer{0};       ///< sum over its CPU segments
    nanoseconds outside{0};          ///< the same of what its threads slept beyond that
    nanoseconds gpu_longer{0};       ///< sum over its GPU segments, less what it was held for
    nanoseconds gpu_expected{0};     ///< what these should have taken
    /// Of that, what its kernels were found to take longer when no other chain was there.
    nanoseconds gpu_by_factor{0};
    nanoseconds beside{0};  ///< work of other chains that was on the GPU meanwhile, all of it
    TimeBehind held;
    TimeBehind shared;    ///< taken by work that goes before it
    TimeBehind kernels;   ///< taken by kernels of work that goes behind it
    TimeBehind priority;  ///< taken by work that should go behind it
    TimeBehind waited;    ///< its streams waited for work of another chain
};

struct Cause {
    MissCause kind = MissCause::kNone;
    int behind = -1;        ///< chain
    nanoseconds amount{0};  ///< that it took
    /// As abi::MissCause says of it; 0: there is none. Saturated.
    std::uint16_t detail = 0;
};

Cause cause_of(const FrameFacts& facts);

/// @returns the cause's name in statistics: "held", "gpu_longer"
const char* to_word(MissCause cause);
/// @param behind  name of the chain; empty: none
/// @param detail  Cause::detail; 0: of several frames, or not known
/// @returns the cause for people: "held behind camera"
std::string in_words(MissCause cause, const std::string& behind, std::uint16_t detail = 0);
inline constexpr std::size_t kNumCauses = static_cast<std::size_t>(MissCause::kOutside) + 1;
static_assert(kNumCauses <= abi::kCauseCounters);

/// A detail that is a time, and one that is a factor.
/// @returns 0 if the cause has none of that kind
nanoseconds short_by(MissCause cause, std::uint16_t detail);
double times_as_long(MissCause cause, std::uint16_t detail);

/// So many frames were late for that.
struct CauseCount {
    MissCause cause = MissCause::kNone;
    std::string behind;  ///< name of the chain; empty: none
    std::uint64_t count = 0;
};

/// What is usual: moves by an eighth of what each value differs, after the first.
class Usual {
  public:
    /// @returns by how much it is longer than usual; 0 for the first
    nanoseconds saw(nanoseconds value);

  private:
    nanoseconds mean_{0};
    bool has_seen_ = false;
};

}  // namespace urgengo::observe
