// SPDX-License-Identifier: Apache-2.0
//
// What is known of kernels and graphs by their handles: their names, and which tasks may begin with
// them. A thread keeps what it has looked up, until handles may come to mean something else.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <mutex>
#include <vector>

#include "host/config/config.h"
#include "host/identity/graphs.h"
#include "host/identity/kernel_cache.h"
#include "host/identity/launch.h"
#include "host/identity/name_gate.h"
#include "host/identity/seen_kernels.h"
#include "host/model/task_set.h"
#include "host/observe/trace_writer.h"

namespace urgengo::identity {

/// A kernel or graph that a thread has launched.
struct KnownKernel {
    const void* function = nullptr;  ///< or executable graph
    std::uint64_t name_hash = 0;
    float utilization = 1;    ///< of a graph
    bool is_new = false;      ///< never launched, as far as is known
    bool needs_room = false;  ///< its blocks have none beside a resident dispatcher
    /// Tasks with a `kernels:` pattern for its name; null: none.
    const model::TaskSet* begins = nullptr;
};

/// A thread's own.
struct KernelsOfThread : KernelCache<KnownKernel> {
    std::uint32_t epoch = 0;  ///< Kernels::epoch() when it was emptied last
};

class Kernels {
  public:
    /// @param driver, trace  outlive it
    /// @param trace  where names are written; null: nowhere
    Kernels(const exec::DriverApi& driver, observe::TraceWriter* trace)
        : driver_(driver), trace_(trace), looks_into_graphs_(trace != nullptr) {}

    // Before there are threads:
    /// @param patterns  of the kernels that the task may begin with
    void add_task(int task, const std::vector<config::KernelPattern>& patterns);
    /// Some profile knows graphs by what is in them.
    void look_into_graphs() { looks_into_graphs_ = true; }

    /// @param known, cursor  the calling thread's
    /// @returns what is launched; until the thread's next look
    KnownKernel& find(KernelsOfThread& known, observe::TraceCursor& cursor, const Launch& launch) {
        // A graph's handle is told from a kernel's at the same address, later or earlier, by one
        // bit.
        const void* handle = launch.function;
        if (!handle) handle = reinterpret_cast<const char*>(launch.graph) + 1;
        const std::uint32_t now = epoch();
        // While a thread unloads, no name can be read; those that are known are those of the
        // kernels that may be launched.
        if (known.epoch != now && !gate_.is_closed()) [[unlikely]] {
            known.clear();
            known.epoch = now;
        }
        if (KnownKernel* kernel = known.find(handle)) [[likely]]
            return *kernel;
        return look_up(known, cursor, launch, handle);
    }

    /// Kernels' handles may come to mean other kernels.
    void forget() {
        seen_.forget();
        epoch_.fetch_add(1, std::memory_order_relaxed);
    }
    /// @returns a number that changes when handles may have come to mean something else
    std::uint32_t epoch() const { return epoch_.load(std::memory_order_relaxed); }
    /// What unloads is in NameGate::Unloading meanwhile.
    NameGate& gate() { return gate_; }

    /// Which task will launch a graph is not known when it is made, and looking into it costs a few
    /// questions a node. So it is done only where the name can matter: while a profile is learned,
    /// and when the profile in use knows some graph. A profile that knows none finds a graph of any
    /// name unknown.
    /// @returns whether graph_instantiated() is wanted
    bool looks_into_graphs() const {
        return looks_into_graphs_ && driver_.cuGraphGetNodes && driver_.cuGraphNodeGetType;
    }
    /// @param context  as of Graphs::add()
    void graph_instantiated(CUgraphExec executable, CUgraph graph,
                            const exec::MarkContext* context) {
        // If the handle was another's. (Kernels' handles are what they were.)
        if (graphs_.add(executable, graph, context)) epoch_.fetch_add(1);
    }
    void graph_destroyed(CUgraphExec executable) { graphs_.remove(executable); }
    const Graphs& graphs() const { return graphs_; }

  private:
    struct Pattern {
        int task = 0;
        std::string name_glob;
    };

    KnownKernel& look_up(KernelsOfThread& known, observe::TraceCursor& cursor, const Launch& launch,
                         const void* handle);
    void look_up_graph(KnownKernel& kernel, observe::TraceCursor& cursor, CUgraphExec graph);
    const model::TaskSet* kept(const model::TaskSet& set);

    const exec::DriverApi& driver_;
    observe::TraceWriter* const trace_;
    bool looks_into_graphs_;
    std::vector<Pattern> patterns_;
    std::atomic<std::uint32_t> epoch_{1};
    NameGate gate_;
    Graphs graphs_{driver_, gate_};
    SeenKernels seen_;
    std::mutex sets_mutex_;
    std::deque<model::TaskSet> begin_sets_;  ///< KnownKernel::begins
};

}  // namespace urgengo::identity
