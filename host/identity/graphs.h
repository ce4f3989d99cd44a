// SPDX-License-Identifier: Apache-2.0
//
// Executable graphs as the scheduler sees them: one unit each, with a name that is the same in
// every run of the program, so that profiles know it: "(graph of 53 kernels, 8f3a12bc)". The number
// is a hash of what is in it: the kernels' names and block sizes, in an order that does not depend
// on handles, and the kinds of the other nodes. Grids are left out, because updates change them.
// Looked at once, when the program instantiates it: by its first launch the graph that it was made
// of may be gone. Nothing of it is changed.
#pragma once

#include <cuda.h>

#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>

#include "host/exec/progress_marks.h"
#include "host/identity/name_gate.h"

namespace urgengo::identity {

struct GraphUnit {
    std::string name;
    std::uint64_t name_hash = 0;
    double utilization = 1;  ///< mean over its kernels, 0..1
};

/// Threads: any. Takes a lock: threads keep what they have looked up.
class Graphs {
  public:
    /// @param driver, gate  outlive it
    Graphs(const exec::DriverApi& driver, NameGate& gate) : driver_(driver), gate_(gate) {}

    /// Looks into a graph that was made executable: in relaxed capture mode.
    /// @param context  not null: how much of the GPU its kernels take is looked at, too. Else it
    ///                 counts as taking all of it
    /// @returns whether this handle has ever meant another graph: what was looked up then is wrong
    ///          now
    bool add(CUgraphExec executable, CUgraph graph, const exec::MarkContext* context);
    /// It will be destroyed.
    void remove(CUgraphExec executable);
    /// @returns nothing of one that is not known
    std::optional<GraphUnit> find(CUgraphExec executable) const;

  private:
    struct Contents;
    void describe_nodes(CUgraph graph, Contents& contents, int depth) const;

    const exec::DriverApi& driver_;
    NameGate& gate_;
    mutable std::mutex mutex_;
    std::unordered_map<CUgraphExec, GraphUnit> units_;  ///< without a name: destroyed
};

}  // namespace urgengo::identity
