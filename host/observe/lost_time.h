// SPDX-License-Identifier: Apache-2.0
//
// What a frame lost on the GPU, and to whom: from the pieces in which its own work was executed and
// those of all others (executed_pieces.h).
//
//  1 A piece that took longer than its work by the plan has lost the difference.
//  2 Its own kernels may take longer by themselves. The pieces in which no other task had anything
//    to execute tell how many times as long as planned: their median, by work. All of the frame's
//    work is taken to be so. Where there are too few of them, the task's factor is (estimates,
//    corrected while it was alone).
//  3 What its other pieces lost beyond that is of those who executed meanwhile, piece by piece, in
//    proportion to how long they did. Another's work is taken to be the last of its piece: it waits
//    for others at its begin more often than it is slowed down. A piece in which no other task
//    executed is of those that had something to execute.
//  4 What they took is told by kind: by work that goes before the frame's; by work that goes behind
//    it and came later, with a priority to; and by other work that goes behind it, which was there
//    first, as a kernel cannot be interrupted.
//  5 A hold counts for those who executed meanwhile, and where no task did for the one that it
//    was behind. Time in which the frame's own work was on the GPU is no hold.
//  6 Work of no chain is not seen. Where bystanders are known to be about, they are there whenever
//    all tasks together get on more slowly than kFull of the GPU would: told for kBin at a time.
//  7 It is told in the program's thread, at the end of a frame. So where more pieces meet than
//    kManyPairs, they are joined with their neighbours first; a frame of 500 pieces beside ten
//    others' 500 each is below that.
//  8 Of a frame with many segments only the last are known. What they have lost tells whose it was
//    that all of them took longer (FramesWork::all_longer).
//
// Checked against CUPTI's records (tools/bench/causes_check.py): docs/measurements.md.
//
// Pure: no clock, no thread.
#pragma once

#include <chrono>
#include <cstddef>
#include <optional>
#include <vector>

#include "host/observe/executed_pieces.h"

namespace urgengo::observe {

/// In place of a chain: its work is of none, and it is of one that is not known. Both are -1 where
/// a cause is told (Cause::behind).
inline constexpr int kNoChain = -1;
inline constexpr int kUnknownChain = -2;

/// A chain that a frame lost time to.
struct LostTo {
    int chain = kNoChain;        ///< or kNoChain, kUnknownChain
    nanoseconds held{0};         ///< launches were held meanwhile
    nanoseconds by_urgent{0};    ///< taken by work that goes before
    nanoseconds by_kernel{0};    ///< by a kernel of work that goes behind
    nanoseconds by_priority{0};  ///< by work that should go behind, and had the priority not to
    nanoseconds waited{0};       ///< for its work

    nanoseconds taken() const { return by_urgent + by_kernel + by_priority; }
};

/// A GPU segment of another chain.
struct OthersSegment {
    int chain = 0;
    nanoseconds deadline{0};  ///< of its instance
    int first_priority = 0;  ///< of its launches, as the driver takes them: the smallest goes first
    std::vector<ExecutedPiece> pieces;
};

struct HoldSpan {
    nanoseconds begin{0}, end{0};
    int behind = kUnknownChain;  ///< chain
};

/// A late frame.
struct FramesWork {
    nanoseconds deadline{0};
    std::vector<ExecutedPiece> pieces;  ///< in order
    std::vector<HoldSpan> holds;
    int last_priority = 0;  ///< of its launches
    /// Its kernels take so many times as long as planned, as far as that is known.
    double factor = 1;
    int waits_for = -1;  ///< its streams waited for work of this chain
    bool beside_bystanders = false;
    nanoseconds gaps{0};  ///< alone, its segments take so much longer than their kernels
    /// Of a frame whose kernels have no plan: that it took beyond what is usual. What others
    /// executed meanwhile took of it, and not more.
    std::optional<nanoseconds> longer;
    /// Segments of it are forgotten: what all of them took beyond what is planned.
    std::optional<nanoseconds> all_longer;
    /// In holds that are forgotten: counts for whom the others were behind most.
    nanoseconds held_before{0};
};

struct LostTime {
    nanoseconds by_itself{0};
    std::vector<LostTo> others;
    /// Pieces and pairs of them that were looked at; beside its pieces, and beside its holds.
    std::size_t pairs_of_pieces = 0, pairs_of_holds = 0;
};

/// From so many pairs on pieces are joined; and so many are looked at at most, where own pieces
/// overlap.
/// @source a pair takes some 10 ns on a 2-core machine: 1 ms in all
inline constexpr std::size_t kManyPairs = 1 << 14;
inline constexpr std::size_t kMostPairs = 1 << 16;

LostTime lost_time(FramesWork own, std::vector<OthersSegment> others);

}  // namespace urgengo::observe
