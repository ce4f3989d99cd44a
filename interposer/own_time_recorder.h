// SPDX-License-Identifier: Apache-2.0
//
// Keeps what a thread's calls have spent (own_time.h), by kind of call and by frame. Every thread
// has a recorder of its own, made at its first call and kept to the end; at exit all are merged.
//
// A frame is what a thread does from one ug_arrival() to its next: a whole instance where a chain
// has one thread and says when frames arrive.
#pragma once

#include <array>
#include <string>

#include "host/base/own_time.h"
#include "interposer/own_time_histogram.h"

namespace urgengo::interposer {
enum class CallClass;
}

namespace urgengo::own_time {

inline constexpr std::size_t kNumClasses = 6;

/// In ticks.
struct CallTimes {
    Histogram added;  ///< by us, but for holds
    Histogram held;   ///< of those that were
    Histogram in_driver;
};
struct FrameTimes {
    Histogram added, deciding, in_our_driver, held, polling;
    Histogram launches, decisions;  ///< not times
};
struct Times {
    std::array<CallTimes, kNumClasses> calls;
    FrameTimes frames;
};

class Recorder {
  public:
    /// What reading the counter takes. @threads any
    static std::uint64_t read_ticks();

    void add(interposer::CallClass call, const Spent& spent, std::uint64_t ticks);
    void frame_begins();
    /// The frame at hand counts as over.
    void merge_into(Times& all) const;

  private:
    struct Frame {
        Spent spent;
        std::uint64_t added = 0, launches = 0;
        bool arrived = false;  ///< else it is what came before the first one
    };
    static void add_frame(const Frame& frame, FrameTimes& frames);

    Times times_;
    Frame frame_;
};

/// The calling thread's.
Recorder& recorder();

/// @returns all threads' times as JSON: nanoseconds
std::string to_json(double ns_per_tick);

}  // namespace urgengo::own_time
