// SPDX-License-Identifier: Apache-2.0
//
// Without hints: when the frame has arrived that a thread begins with, also where the thread is
// behind and its program leaves frames out.
//
// 1 A frame has arrived as long before its first call as the thread has computed since its last
//   wait for the GPU. If the thread has slept meanwhile, it waited for that frame: this is sure.
// 2 A thread that has not slept, and had not begun with its last frame when that came, is behind.
//   Its frame has arrived a period after the one before, if the program works off all of them; or
//   the program keeps the last few frames, as queues of sensors do (KEEP_LAST of ROS), and leaves
//   out older ones. Then no frame is older than the queue is long, however long the thread is
//   behind. (Seven traced networks of which each keeps two, simulated, GPU times over periods 1.1,
//   with stalls: 21 % missed where all seemed ever later, 7.4 so, 5.3 told the true arrivals.)
// 3 That frames are left out is counted: from one sure arrival to the next so many periods have
//   passed, and so many frames were begun. A thread that is far behind for long is taken for one
//   that does. How many are kept is found by playing each number: one is too small if by it the
//   thread begins with a frame before that has come.
//
// What it does not know: a program that works off all frames and is never done is taken to keep
// two, after 16 frames far behind. A thread that serves several chains, or a chain that several
// threads serve, has nothing learned: its frames arrive a period apart, as long as it is behind.
//
// The thread's own.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>

#include "host/sched/governed.h"

namespace urgengo::sched {

class Backlog {
  public:
    /// @param chain  whose frame the thread begins with now
    /// @param end    of its last wait; 0: there was none
    /// @param cpu    time that it has computed since then
    /// @returns when that has arrived
    nanoseconds begin_frame(const GovernedChain& chain, nanoseconds end, nanoseconds cpu,
                            nanoseconds now);

    /// A thread off the CPU for less than this between two instances did not wait for its next
    /// frame.
    static constexpr nanoseconds kNotAsleep{500'000};

  private:
    static constexpr std::size_t kMostKept = 4;
    static constexpr int kMostRefuted = 3, kRefuted = 2;

    bool is_sure(nanoseconds begin, nanoseconds end) const;
    /// @returns how many frames have come since anchor_ if all are punctual; the most there can be
    std::int64_t come(nanoseconds time) const { return (time - anchor_) / period_; }
    std::int64_t come_at_most(nanoseconds time) const;
    void caught_up(nanoseconds arrival, nanoseconds end);
    nanoseconds behind(nanoseconds begin, nanoseconds oldest);
    std::size_t num_kept() const;
    bool leaves_out() const;

    nanoseconds period_{0};
    nanoseconds last_{0};        ///< arrival that was told last
    nanoseconds last_begin_{0};  ///< of that frame
    nanoseconds anchor_{0};      ///< the last sure arrival; 0: none yet
    std::int64_t begun_ = 0;     ///< frames since then
    int far_behind_ = 0;         ///< of these, in a row, farther than makes a difference
    bool was_behind_ = false;    ///< since then: by two frames
    int left_out_ = 0;           ///< in so many more runs of frames than not
    /// By how many frames are kept, less 1.
    struct Count {
        std::int64_t frame = 0;    ///< the last one begun by it, from anchor_ on
        bool refuted_now = false;  ///< since then
        int refuted = 0;           ///< in so many more runs of frames than not

        bool is_too_small() const { return refuted >= kRefuted || refuted_now; }
    };
    std::array<Count, kMostKept> counts_{};
};

}  // namespace urgengo::sched
