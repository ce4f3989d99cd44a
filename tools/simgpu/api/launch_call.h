// SPDX-License-Identifier: Apache-2.0
//
// A call that launches kernels, as a tool sees it that watches calls (simgpu.h): it has an id,
// which its kernels carry, and the tool is told when it begins and ends, in the calling thread.
#pragma once

#include <cstdint>

#include "tools/simgpu/simgpu.h"

namespace urgengo::simgpu {

class LaunchCall {
  public:
    LaunchCall();
    ~LaunchCall();
    LaunchCall(const LaunchCall&) = delete;
    LaunchCall& operator=(const LaunchCall&) = delete;

    /// @returns the id of the calling thread's; 0 if it is in none
    static std::uint64_t current();
    static void set_hook(simgpu_launch_hook hook);

  private:
    const std::uint64_t outer_;
};

}  // namespace urgengo::simgpu
