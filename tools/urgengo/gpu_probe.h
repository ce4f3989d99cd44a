// SPDX-License-Identifier: Apache-2.0
//
// Whether this machine has a GPU that the driver can use.
#pragma once

#include <string>

namespace urgengo::cli {

struct GpuProbe {
    bool found = false;
    std::string name;     ///< of the first device
    std::string problem;  ///< why none was found
};

/// Asks the driver in a forked child: once initialised it leaves threads and files in a process,
/// and a driver in disorder may hang or crash. Waits at most 30 s.
/// @param library  empty: libcuda.so.1, as the loader finds it
GpuProbe probe_gpu(const std::string& library);

}  // namespace urgengo::cli
