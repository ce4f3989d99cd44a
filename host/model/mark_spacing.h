// SPDX-License-Identifier: Apache-2.0
//
// Where marks go. A mark costs GPU time, and between two marks the position is a guess; so they
// stand where a guess would cost most.
//
//  1 Wanted distance: `every` of estimated work. Near the end of a chain that still can meet its
//    deadline, and hardly, it shrinks with the laxity and with what remains, down to a quarter:
//
//        wanted = every * clamp(max(laxity, remaining) / (kNearEnd * every), 1/4, 1)
//
//    A chain past the point of no return ranks last: nobody asks where it is.
//  2 A mark stands between launches: the one nearest to the wanted distance is taken, so a mark is
//    due when at least half of the next launch would lie beyond it.
//  3 A long kernel (at least half of `every`) has a mark before it and one behind it: the guess in
//    it then begins with its begin, and what comes after is not blurred by how long it took.
//  4 A segment's end always has one: there the CPU goes on, and others may. None shortly before it
//    (a quarter of what is wanted), where it would tell the same.
//  5 Marks that fall between the same launches in every instance tell what those take together, and
//    never what each one does (durations.h). So 2 aims at a distance that varies around the wanted
//    one, by up to `dither` of it, with the mark's number.
//  6 Budget. Marks may take `max_share` of the GPU time of the work that they mark, counted over
//  the
//    task's life: work earns, marks spend. 1 to 3 ask for a mark only when it is paid for. Unspent
//    earnings are kept for kMaxSaved marks, for the dense places. The mark at a segment's end may
//    be owed for, up to kMaxOwed marks; a task whose segments are so short that this is used up
//    loses the marks at some of their ends, and the wait that follows tells the same. So the share
//    holds in the long run, whatever the program does: spent <= max_share * work + kMaxOwed * cost.
//
// Pure functions. Any thread.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>

namespace urgengo::model {

using std::chrono::nanoseconds;

/// GPU time of a mark kernel, launched plainly and with programmatic stream serialisation, and of a
/// stream write; an event without timing is free. @source FACTS.md, H200, chain of 400 kernels
inline constexpr nanoseconds kPlainMarkCost{1'700};
inline constexpr nanoseconds kProgrammaticMarkCost{830};
inline constexpr nanoseconds kWriteMarkCost{2'000};

struct MarkSpacing {
    nanoseconds every{200'000};
    nanoseconds cost = kProgrammaticMarkCost;  ///< 0: free
    double max_share = 0.005;                  ///< of GPU time
    double dither = 0.25;                      ///< 0..1; 0: none
};

/// What a task's marks may still cost; see 6.
class MarkBudget {
  public:
    static constexpr int kMaxSaved = 16;
    static constexpr int kMaxOwed = 8;

    void earn(const MarkSpacing& spacing, nanoseconds work) {
        const double most = static_cast<double>(kMaxSaved * spacing.cost.count());
        balance_ns_ =
            std::min(balance_ns_ + spacing.max_share * static_cast<double>(work.count()), most);
    }
    void spend(const MarkSpacing& spacing) {
        balance_ns_ -= static_cast<double>(spacing.cost.count());
    }
    double balance_ns() const { return balance_ns_; }

  private:
    double balance_ns_ = 0;
};

/// Behind a launch.
struct MarkSituation {
    nanoseconds since_mark{0};   ///< estimated work launched since the last mark
    nanoseconds last_launch{0};  ///< estimate of this launch, part of since_mark
    nanoseconds next_launch{0};  ///< and of the one expected next: remaining_from(p) less (p + 1)
    nanoseconds to_segment_end{0};  ///< estimated work still to launch in this segment
    bool at_segment_end = false;    ///< the plan's last launch of it, or its wait begins
    nanoseconds laxity{0};          ///< of the chain, now
    nanoseconds remaining{0};       ///< estimated GPU time of the chain's instance
    std::uint32_t sequence = 0;     ///< of the mark that would come
};

/// Near its end is a chain that has so many times `every` left to do, and as much laxity.
inline constexpr int kNearEnd = 10;

/// @returns the distance between marks for this situation; see 1
nanoseconds wanted_distance(const MarkSpacing& spacing, const MarkSituation& at);

/// @returns whether a mark is to follow this launch
bool mark_is_due(const MarkSpacing& spacing, const MarkSituation& at, const MarkBudget& budget);

}  // namespace urgengo::model
