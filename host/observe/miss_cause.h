// SPDX-License-Identifier: Apache-2.0
//
// Why a frame was late: one cause, from what was measured of the frame and of the others meanwhile.
//
// 1 What went otherwise than it should is summed up in times: how much later than it should its
//   first task began, how much longer than profiled the CPU took and its own kernels did, and what
//   each other chain took from it: by its work on the GPU, or while launches were held for it.
// 2 The largest of these is the cause, if it is a fair part of the lateness, or if all that others
//   took together is. So a frame that was late by 3 ms, was held for 10 and computed for 4 longer
//   was late because it was held. What a chain took by its work on the GPU is one of these, and is
//   told as its largest kind.
// 3 What the frame lost on the GPU, by itself and to whom, is told from marks: lost_time.h.
// 4 An instance that was given up went behind the others, because it was given up. Its own times
//   come before that: they are why it was.
//
// Pure: no clock, no thread.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "host/observe/lost_time.h"
#include "host/sched/given_up.h"
#include "urgengo/abi/status_page.h"

namespace urgengo::observe {

using abi::MissCause;
using std::chrono::nanoseconds;

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
    nanoseconds gpu_longer{0};       ///< that its own kernels took, by themselves
    nanoseconds gpu_expected{0};     ///< what its GPU segments should have taken
    std::vector<LostTo> lost_to;
};

struct Cause {
    MissCause kind = MissCause::kNone;
    int behind = -1;        ///< chain; -1: none, or it is not known
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
