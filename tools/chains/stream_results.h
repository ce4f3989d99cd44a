// SPDX-License-Identifier: Apache-2.0
//
// What the kernels leave behind per stream. Laid out the same on host and device; device memory,
// zeroed before the run, read once after it. Every block of every launch adds to it, so a launch
// that was dropped, doubled or overtaken by a later one on its stream shows.
#pragma once

namespace urgengo::chains {

struct StreamResults {
    unsigned long long sum;      ///< of every block's value (checksum.h says what it must be)
    unsigned blocks_done;        ///< modulo 2^32
    unsigned blocks_misordered;  ///< began before an earlier launch had ended, or after a later one
};

}  // namespace urgengo::chains
