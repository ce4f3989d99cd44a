// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cuda.h>

#include <cstdint>

#include "host/exec/driver_api.h"

namespace urgengo::identity {

/// A launch as the program asked for it.
struct Launch {
    CUfunction function = nullptr;  ///< null: `graph` is launched
    std::uint64_t grid_blocks = 1;
    std::uint32_t block_threads = 1;
    CUstream stream = nullptr;
    exec::StreamFlavor flavor = exec::StreamFlavor::kLegacy;
    bool depends_on_previous = false;  ///< programmatically: nothing may come between
    std::uint32_t shared_bytes = 0;    ///< dynamic, a block
    CUgraphExec graph = nullptr;
    bool asks_priority = false;  ///< the program has set one for this launch:
    int priority = 0;
};

}  // namespace urgengo::identity
