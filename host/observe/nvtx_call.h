// SPDX-License-Identifier: Apache-2.0
//
// A call of another NVTX tool, on the thread's way through one of the program's calls. The tool may
// open and write files, which would be a cancellation point that the program's call is not; and it
// may have taken a lock of its own when a signal's handler calls exit().
#pragma once

#include <utility>

#include "host/base/uncancelled.h"

namespace urgengo::observe {

class NvtxCall {
  public:
    NvtxCall() = default;
    ~NvtxCall() { t_is_under_way = was_under_way_; }
    NvtxCall(const NvtxCall&) = delete;
    NvtxCall& operator=(const NvtxCall&) = delete;

    /// @returns whether the calling thread is in one
    static bool is_under_way() { return t_is_under_way; }

  private:
    static constinit inline thread_local bool t_is_under_way = false;
    const Uncancelled uncancelled_;
    const bool was_under_way_ = std::exchange(t_is_under_way, true);
};

}  // namespace urgengo::observe
