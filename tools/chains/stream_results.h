// SPDX-License-Identifier: Apache-2.0
//
// What the kernels leave behind per stream. Laid out the same on host and device; device memory,
// zeroed before the run, read once after it. Every block of every launch adds to it, so a launch
// that was dropped, doubled or overtaken by a later one on its stream shows.
//
// Where asked for, every launch also leaves a stamp: when its first block began, and when its last
// one had computed its results. Asked for by kWithStamps in the address that the kernels get, so
// that a kernel without stamps does not even load a pointer more.
#pragma once

namespace urgengo::chains {

/// Of one launch; nanoseconds of %globaltimer.
struct LaunchStamp {
    unsigned long long begin_ns;  ///< the least of its blocks' begins; all ones: it never ran
    unsigned long long end_ns;    ///< the last block's, read when all have ended
};

/// As struct simgpu_stamps (tools/simgpu/simgpu.h), for the simulated GPU leaves them, too.
struct LaunchStamps {
    LaunchStamp* stamps;  ///< in device memory
    unsigned room;        ///< launches beyond leave none, but count
    unsigned launches;    ///< that have ended with stamps; thus the next one's index
};

struct StreamResults {
    LaunchStamps stamps;         ///< first, where the simulated GPU looks for it
    unsigned long long sum;      ///< of every block's value (checksum.h says what it must be)
    unsigned blocks_done;        ///< modulo 2^32
    unsigned blocks_misordered;  ///< began before an earlier launch had ended, or after a later one
};

/// Added to the address of StreamResults.
inline constexpr unsigned long long kWithStamps = 1;

}  // namespace urgengo::chains
