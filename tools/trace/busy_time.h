// SPDX-License-Identifier: Apache-2.0
//
// How long at least one of several kernels was on the GPU: the union of their intervals, and what
// it grows by with each. On one stream a kernel's share is its own time; of two that run at once
// the second adds only what the first does not cover. So the shares add up to the busy time.
#pragma once

#include <cstdint>
#include <map>

namespace urgengo::trace {

class BusyTime {
  public:
    /// @returns by how much the union grows; 0 for an interval that is empty
    std::int64_t add(std::int64_t begin_ns, std::int64_t end_ns);

    std::int64_t total_ns() const { return total_ns_; }

  private:
    std::map<std::int64_t, std::int64_t> busy_;  ///< disjoint: begins and ends
    std::int64_t total_ns_ = 0;
};

}  // namespace urgengo::trace
