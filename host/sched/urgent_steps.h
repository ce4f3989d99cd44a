// SPDX-License-Identifier: Apache-2.0
//
// The steps of TH_urgent's histogram (urgent_threshold.h): laxities, a 16th of a power of two wide
// each. Host and GPU share them, to the bit.
//
// @threads any; pure
#pragma once

#include <cstdint>

#include "urgengo/abi/dispatcher.h"

namespace urgengo::sched {

/// @returns the step that a laxity falls in, below abi::kUrgentSteps; below 16 ns it counts as 16
constexpr std::uint32_t urgent_step_of(std::int64_t laxity_ns) {
    const auto ns = static_cast<std::uint64_t>(laxity_ns < 16 ? 16 : laxity_ns);
    std::uint32_t octave = 0;
    for (std::uint32_t shift = 32; shift > 0; shift /= 2)
        if (ns >> (octave + shift) != 0) octave += shift;
    return octave * 16 + static_cast<std::uint32_t>(ns >> (octave - 4) & 15);
}

/// @returns the laxity, ns, at which a step that holds one ends
constexpr std::int64_t end_of_urgent_step(std::uint32_t step) {
    return static_cast<std::int64_t>(std::uint64_t{16 + step % 16 + 1} << (step / 16 - 4));
}

/// The share of laxities below the threshold is that of urgencies above the percentile.
/// @returns how many of so many records may be below it
constexpr double urgent_records(std::uint64_t records, double percentile) {
    return static_cast<double>(records) * (1 - percentile / 100);
}

}  // namespace urgengo::sched
