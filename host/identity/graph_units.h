// SPDX-License-Identifier: Apache-2.0
//
// Executable graphs as the scheduler sees them: one unit each, with a name that is the same in
// every run of the program, so that profiles know it: "(graph of 53 kernels, 8f3a12bc)". The number
// is a hash of what is in it: the kernels' names and block sizes, in an order that does not depend
// on handles, and the kinds of the other nodes. Grids are left out, because updates change them.
#pragma once

#include <cuda.h>

#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>

namespace urgengo::identity {

struct GraphUnit {
    std::string name;
    std::uint64_t name_hash = 0;
    double utilization = 1;  ///< mean over its kernels, 0..1
};

/// Threads: any. Takes a lock: threads keep what they have looked up.
class GraphUnits {
  public:
    /// @returns whether this handle has ever meant another graph: who has looked that up is wrong
    /// now
    bool add(CUgraphExec graph, GraphUnit unit) {
        const std::lock_guard lock(mutex_);
        return !units_.insert_or_assign(graph, std::move(unit)).second;
    }
    void remove(CUgraphExec graph) {
        const std::lock_guard lock(mutex_);
        if (const auto unit = units_.find(graph); unit != units_.end()) unit->second = {};
    }
    std::optional<GraphUnit> find(CUgraphExec graph) const {
        const std::lock_guard lock(mutex_);
        const auto unit = units_.find(graph);
        return unit == units_.end() || unit->second.name.empty() ? std::nullopt
                                                                 : std::optional(unit->second);
    }

  private:
    mutable std::mutex mutex_;
    std::unordered_map<CUgraphExec, GraphUnit> units_;  ///< without a name: destroyed
};

}  // namespace urgengo::identity
