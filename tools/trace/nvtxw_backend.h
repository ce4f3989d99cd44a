// SPDX-License-Identifier: Apache-2.0
//
// The library that takes what is written through NVTXW: found and loaded.
//
// A named one is the only one: NVTXW3_LIBRARY, or NVTXW_BACKEND, by which programs of version 1 are
// told. Else libnvtxw3.so in urgengo's own folder, and where the loader finds it. Not in the folder
// that the user is in, where NVTX's own loader looks, too: a file there may be anyone's.
#pragma once

#include <string>

#include "host/base/result.h"

namespace urgengo::trace {

namespace nvtxw {
struct Interface;
}

struct NvtxwBackend {
    std::string path;  ///< as it was asked for
    const nvtxw::Interface* interface = nullptr;
};

/// It stays loaded.
/// @errors one line: what was looked for and where, and what was wrong with it
Result<NvtxwBackend> load_nvtxw_backend();

}  // namespace urgengo::trace
