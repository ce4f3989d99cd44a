// SPDX-License-Identifier: Apache-2.0
//
// Asks the driver something in a forked child: once initialised it leaves threads and files in a
// process, and a driver in disorder may hang or crash.
#pragma once

#include <dlfcn.h>

#include <chrono>
#include <functional>
#include <string>

#include "host/base/result.h"

namespace urgengo::cli {

/// Runs `ask` in a child whose output goes nowhere, and where CUDA_INJECTION64_PATH and
/// CUDA_LAUNCH_BLOCKING are not set: no tool is loaded, no launch waits for its end.
/// @returns what `ask` returned: a text without zero bytes
/// @errors there is no child, it crashed, or `limit` was over before it answered: one line
Result<std::string> ask_in_child(const std::function<std::string()>& ask,
                                 std::chrono::milliseconds limit);

/// The driver's library, opened and never closed: for use in such a child.
class DriverLibrary {
  public:
    /// @param path  empty: libcuda.so.1, as the loader finds it
    explicit DriverLibrary(const std::string& path)
        : handle_(dlopen(path.empty() ? "libcuda.so.1" : path.c_str(), RTLD_NOW | RTLD_LOCAL)) {
        if (!handle_) problem_ = dlerror();
    }

    /// @returns why it could not be opened; empty if it could
    const std::string& problem() const { return problem_; }

    /// @returns null if the driver has no such function
    template <typename Function>
    Function find(const char* name) const {
        return handle_ ? reinterpret_cast<Function>(dlsym(handle_, name)) : nullptr;
    }

  private:
    void* handle_;
    std::string problem_;
};

}  // namespace urgengo::cli
