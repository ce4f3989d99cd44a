// SPDX-License-Identifier: Apache-2.0
//
// How CLOCK_MONOTONIC and %globaltimer relate, found without UrgenGo: a kernel answers the host's
// questions with its time; of many round trips the shortest one tells most.
#pragma once

#include "tools/chains/gpu.h"
#include "tools/chains/stamps_file.h"

namespace urgengo::chains {

/// Takes a few milliseconds, in which one thread of the GPU is busy.
/// @throws CudaError also when the kernel does not answer
ClockReading read_clocks(const Gpu& gpu);

}  // namespace urgengo::chains
