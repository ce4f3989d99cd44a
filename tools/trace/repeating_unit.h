// SPDX-License-Identifier: Apache-2.0
//
// Finds the unit that a sequence of segments repeats: the segments of one instance.
//
//  1 Period. Segments have a type (first kernel, its size, launch count, closing wait), taken
//    strictly or, if need be, more loosely: sizes may vary, then launch counts too. The period is a
//    lag at which the last two thirds of the sequence match themselves: the one that takes the
//    chain's period, of whichever type; else the shortest of the strictest type, unless a longer
//    one matches clearly better (a unit of many equal segments and one other matches itself at lag
//    1 almost everywhere).
//  2 Phase. A unit begins with the segment that the thread spends most time off the CPU before,
//    since that is where it waits for its frame; if it spends none (it polls), after the longest
//    gap. Where it is known which kernels begin the task, only such segments qualify.
//  3 The sequence is then scanned for the unit, so that an irregular segment costs one instance and
//    never shifts the ones after it. What lies before the first match is start-up.
//  4 Bursts: if nothing repeats, or the unit repeats several times as often as the chain's period
//    says, an instance is what lies between two idle gaps.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace urgengo::trace {

inline constexpr std::size_t kTypeLevels = 3;  ///< strict first

struct UnitSegment {
    std::array<std::uint64_t, kTypeLevels> types{};
    std::int64_t begin_ns = 0;
    std::int64_t idle_ns = 0;  ///< off the CPU before it
    std::int64_t gap_ns = 0;   ///< wall time before it
    bool begins_task = false;
};

using UnitSequence = std::vector<UnitSegment>;  ///< of one thread, in time order

struct RepeatingUnit {
    std::size_t level = 0;             ///< of the types
    std::vector<std::uint64_t> types;  ///< of an instance's segments; not empty
    double match = 0;                  ///< share of segments that equal the one a unit later
};

/// @param period_ns  as the chain has it; 0: not known
/// @returns nothing if nothing repeats
std::optional<RepeatingUnit> find_unit(const std::vector<UnitSequence>& sequences,
                                       std::int64_t period_ns);

/// One instance: segments [begin, begin + count) of a sequence.
struct UnitSpan {
    std::size_t begin = 0;
    std::size_t count = 0;
};

/// @returns where the unit stands in the sequence
std::vector<UnitSpan> find_spans(const UnitSequence& sequence, const RepeatingUnit& unit);

/// Cuts the sequence at its idle gaps.
/// @param period_ns  about how far apart the gaps are; 0: not known
/// @returns nothing if the gaps do not stand out
std::vector<UnitSpan> find_bursts(const UnitSequence& sequence, std::int64_t period_ns);

/// @returns the median time between the spans' begins; 0 if there are fewer than two
std::int64_t median_spacing_ns(const UnitSequence& sequence, const std::vector<UnitSpan>& spans);

}  // namespace urgengo::trace
