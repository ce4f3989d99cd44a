// SPDX-License-Identifier: Apache-2.0
//
// Reads what a process under UrgenGo tells of itself (include/urgengo/abi/status_page.h), without
// asking the process: it may hang, be stopped, or have been killed.
//
// The file is copied by read() before it is looked at: one that is cut short meanwhile is an error,
// not a signal, and what is read of it is as far as this version knows it. Nothing in it is
// believed: counts, offsets and indices are held against the file's size, and names are cleaned of
// what a terminal would obey.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "host/observe/mode_word.h"
#include "host/observe/page_folder.h"
#include "urgengo/abi/status_page.h"

namespace urgengo::cli {

using std::chrono::nanoseconds;

struct TaskReading {
    std::string name;
    std::size_t chain = 0;
    std::uint32_t num_kernels = 0;  ///< of its plan; 0: it has none
    /// The launch of its plan that the GPU is at, or that it waits for, as of its last mark; from
    /// 1. 0: it works on no instance, or the page does not list the plan.
    std::uint32_t kernel = 0;
    std::string kernel_name;      ///< mangled, perhaps cut off; empty: not known
    std::optional<int> priority;  ///< of its last launches: the smallest goes first
    double factor = 1;            ///< what its estimates are multiplied by, to be what was measured
    abi::TaskState state = abi::TaskState::kIdle;
    bool waits_for_gpu = false;
    nanoseconds planned_gpu{0};
    nanoseconds remaining_gpu{0};  ///< of the task's instance, as of its last mark
    nanoseconds launched{0};       ///< of that, launched and not executed
    nanoseconds laxity{0};         ///< of the instance; only where it works on one
    nanoseconds deadline{0};       ///< the same, on CLOCK_MONOTONIC
    int rank = 0;  ///< among active tasks, by the dispatcher's last round, from 1; 0: none yet
    abi::Why why = abi::Why::kNone;
    int behind = -1;      ///< task that its launch waits for; -1: none
    nanoseconds held{0};  ///< for how long its launch has waited
};

struct ChainReading {
    std::string name;
    nanoseconds period{0}, deadline{0};
    /// What it may be by itself: the config's, or what it was told by `urgengo ctl` if that is
    /// less.
    abi::StatusMode mode = abi::StatusMode::kOff;
    std::uint32_t guard = 0;
    std::vector<std::size_t> tasks;  ///< indices
    std::uint64_t instances = 0, finished = 0, missed = 0, exited = 0;
    std::uint32_t misses_in_a_row = 0, most_misses_in_a_row = 0, late_starts = 0;
    std::uint64_t launches = 0, scheduled = 0, holds = 0;
    nanoseconds held{0}, paced{0}, latency_sum{0}, latency_max{0};
    std::uint64_t would_hold = 0;  ///< ChainStatus::would_hold, and so on
    nanoseconds would_held{0};
    int would_behind = -1;  ///< chain
    std::uint64_t causes[abi::kCauseCounters] = {};
    struct Miss {
        std::uint64_t number = 0;  ///< among those that ended, from 1; 0: none was late
        abi::MissCause cause = abi::MissCause::kNone;
        int behind = -1;  ///< chain
        nanoseconds late{0}, amount{0};
        std::uint16_t detail = 0;  ///< as abi::MissCause says of it
    } last_miss;
    /// Of the last minute, as far as the ring goes back:
    struct Lately {
        std::size_t frames = 0, missed = 0;
        nanoseconds median{0}, p99{0}, max{0};
    } lately;
    struct Frame {
        nanoseconds end{0}, latency{0};  ///< on CLOCK_MONOTONIC
        bool missed = false;
    };
    /// The last that ended, as far as the ring goes back; in their order. The first ones may be
    /// written over while they are read.
    std::vector<Frame> ring;
    std::uint64_t ended = 0;  ///< all that the ring has ever had
    /// Of looks in the last minute (top/collisions.h):
    struct Collisions {
        std::size_t looks = 0, collided = 0;
    } collisions;
    // Of the instance that is under way, if one is:
    int at = -1;  ///< task that works on it, the most urgent one; -1: none
};

struct PageReading {
    observe::ProcessKey process;
    observe::Liveness liveness = observe::Liveness::kThere;
    observe::PageFile file;
    std::string stem, program;
    std::uint32_t version = 0, user = 0;
    abi::StatusMode mode = abi::StatusMode::kOff;
    bool is_over = false, is_controlled = false;
    std::uint32_t control_seen = 0, control_refused = 0;
    std::int64_t control_seen_ns = 0;  ///< when that was answered, CLOCK_MONOTONIC
    std::uint32_t holds_left = 0;      ///< StatusHeader::holds_left
    bool steers_chains = false;        ///< its version heeds words of one chain
    struct Answer {
        std::uint32_t word = 0;
        abi::ControlResult result = abi::ControlResult::kNone;
    };
    std::array<Answer, abi::kControlRing> answers{};
    std::uint32_t text_word = 0;
    std::string text;  ///< StatusHeader::text
    nanoseconds began{0};
    int held_now = 0;  ///< tasks in a hold
    struct Dispatcher {
        std::uint64_t gates = 0;  ///< that were ever closed
        std::uint64_t closed = 0, opened_by_gpu = 0;
        std::uint32_t gpu_rounds = 0;
        nanoseconds gpu_round{0};      ///< mean
        nanoseconds urgent_laxity{0};  ///< TH_urgent, by the GPU's rounds; 0: not known
    } dispatcher;
    nanoseconds looks{0};  ///< StatusHeader::looks_ns
    // Between looks (top/top_rates.h):
    std::optional<double> cores;     ///< that its process keeps busy
    std::optional<double> overhead;  ///< of a core, that looks of held launches take
    std::vector<ChainReading> chains;
    std::vector<TaskReading> tasks;
};

/// @returns a word of the file at that offset, as it is now; none if it cannot be read
using WordNow = std::function<std::optional<std::uint32_t>(std::size_t offset)>;

/// @param now  on CLOCK_MONOTONIC
/// @param word_now  looks at the file that the bytes were copied from: a slot that has changed
/// hands
///                  since is shown idle. Null: the bytes are all that there is
Result<PageReading> parse_page(std::span<const std::byte> bytes, nanoseconds now,
                               const WordNow& word_now = nullptr);

/// Reads the page at the path, and judges whether its process is there: not whether that has become
/// another program, which would mean to read its maps, under a lock that it needs.
/// @param stem  without suffix
Result<PageReading> read_page(const std::string& stem, nanoseconds now);

/// @returns "off", "observe", "enforce", "tripped", "unknown"
using observe::to_word;
/// @returns the weaker one of the chain's mode and the page's
abi::StatusMode mode_of(const PageReading& page, const ChainReading& chain);
/// @returns "there", "stopped", "gone", "elsewhere"
const char* to_word(observe::Liveness liveness);
/// @returns what a launch waits for, in a word
const char* to_word(abi::Why why);
const char* to_word(abi::TaskState state);

}  // namespace urgengo::cli
