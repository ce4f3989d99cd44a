// SPDX-License-Identifier: Apache-2.0
//
// Priorities of executable graphs. A graph that was instantiated with
// CUDA_GRAPH_INSTANTIATE_FLAG_USE_NODE_PRIORITY runs each kernel at the priority that it was
// captured at, for good: no stream's priority reaches it. PyTorch makes all of its graphs so, and
// they stay at priority 0 beside whatever else is on the GPU (measured, H200: a network as a graph
// took 72 ms beside a thread of no chain, 2.4 alone, while eager ones were in time).
//
// So where all kernels of a graph have one priority, as nearly all graphs do, it is instantiated
// without the flag, and what it was to have is remembered here: it then runs at the priority of its
// stream, which is lent the rank's for a launch of a chain, and the graph's own for any other.
//
// Threads: any. find() takes no lock.
#pragma once

#include <cuda.h>

#include <array>
#include <atomic>
#include <mutex>
#include <optional>

#include "host/exec/driver_api.h"

namespace urgengo::exec {

class GraphPriorities {
  public:
    /// @param driver  outlives it
    explicit GraphPriorities(const DriverApi& driver) : driver_(driver) {}

    /// @returns the priority of all kernels in the graph; nothing if they have several, if it has
    ///          none, or if something in it cannot be looked into (a body that runs on a condition)
    /// In relaxed capture mode.
    std::optional<int> of_all_kernels(CUgraph graph) const;

    /// It was instantiated without the flag, and was to have this priority.
    /// @returns false: there are too many; it must be instantiated with the flag
    bool keep(CUgraphExec executable, int priority);
    /// It will be destroyed, or its handle means a graph that was instantiated as it came.
    void forget(CUgraphExec executable);
    /// @returns nothing of a graph that was instantiated as it came
    std::optional<int> find(CUgraphExec executable) const;

  private:
    static constexpr std::size_t kPlaces = 4096, kProbes = 32;
    static constexpr int kNone = 1 << 16;

    struct Place {
        std::atomic<CUgraphExec> executable{nullptr};
        std::atomic<int> priority{kNone};
    };

    /// @param found  (priority) of the kernels so far. @returns false: they have several
    bool look_into(CUgraph graph, std::optional<int>& found, int depth) const;
    static std::size_t place_of(CUgraphExec executable, std::size_t probe);

    const DriverApi& driver_;
    std::mutex mutex_;  // of those that write
    std::array<Place, kPlaces> places_;
};

}  // namespace urgengo::exec
