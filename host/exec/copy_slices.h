// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "host/exec/driver_api.h"

namespace urgengo::exec {

/// A linear asynchronous copy as the program asked for it.
struct Copy {
    CUdeviceptr to = 0, from = 0;  ///< or the host's addresses
    std::size_t bytes = 0;
    CUstream stream = nullptr;
    StreamFlavor flavor = StreamFlavor::kLegacy;
};

/// Asks the driver where the copy's ends lie, and cuts it by that (sched/copies.h).
/// @param slice_bytes  0: none is cut
/// @param[out] on_device  both ends are; not set if the driver cannot be asked
/// @returns the size of all slices but the last; 0: it goes as it came
std::size_t slice_of(const DriverApi& driver, const Copy& copy, std::size_t slice_bytes,
                     bool& on_device);

}  // namespace urgengo::exec
