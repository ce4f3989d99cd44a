// SPDX-License-Identifier: Apache-2.0
//
// Launches that SIMGPU_FAIL asks to fail, by the kernel's name, so that it does not matter which
// entry point carries the launch (injected_errors.h). Filled when the library is loaded, never
// emptied; counting is thread-safe.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "tools/simgpu/api/injected_errors.h"

namespace urgengo::simgpu {

class KernelFailures {
  public:
    /// @threads before any other call
    static void add(const InjectedError& error);

    /// @returns null if no launch of that kernel is to fail; valid until the process ends
    static KernelFailures* find(const std::string& kernel);

    static bool any() { return any_; }

    /// Counts a launch.
    /// @returns how it fails; null if it does not
    const InjectedError* next_launch();

  private:
    static bool any_;
    std::atomic<std::uint64_t> num_launches_{0};
    std::vector<InjectedError> errors_;
};

}  // namespace urgengo::simgpu
