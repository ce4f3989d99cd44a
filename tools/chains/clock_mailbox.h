// SPDX-License-Identifier: Apache-2.0
//
// How host and chains_clock talk: the host asks by writing a new number, the kernel answers with
// %globaltimer and that number. In mapped pinned memory, each side's words on lines of their own.
#pragma once

namespace urgengo::chains {

struct ClockMailbox {
    alignas(128) unsigned asked;  ///< by the host; from 1
    alignas(128) unsigned long long time_ns;
    unsigned answered;  ///< written after time_ns
};

inline constexpr unsigned kClockStop = ~0u;
/// A host that has not asked to stop by then never will.
inline constexpr unsigned long long kClockPatienceNs = 2'000'000'000;

}  // namespace urgengo::chains
