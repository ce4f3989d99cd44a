// SPDX-License-Identifier: Apache-2.0
//
// Graphs. A launched graph is one unit: held as one, at one priority (its stream's, lent for the
// launch), followed by a mark. One that would run its kernels at priorities of their own is made to
// take its stream's as well, if they all have the same (exec/graph_priorities.h); else they keep
// them. What is in it is looked at when it is instantiated, so that profiles know it by name.
#include <atomic>
#include <optional>

#include "interposer/manual/launch.h"
#include "interposer/own_time.h"
#include "interposer/real_driver.h"

using namespace urgengo::interposer;
using urgengo::exec::StreamFlavor;

namespace {

/// Some graph was instantiated without its flag: bystanders' launches are looked at as well.
std::atomic<bool> g_some_lack_their_flag{false};

constexpr unsigned long long kNodePriority = CUDA_GRAPH_INSTANTIATE_FLAG_USE_NODE_PRIORITY,
                             kDeviceLaunch = CUDA_GRAPH_INSTANTIATE_FLAG_DEVICE_LAUNCH;

std::optional<int> own_priority(CUgraphExec graph) {
    if (!g_some_lack_their_flag.load(std::memory_order_relaxed)) return std::nullopt;
    return the_runtime().streams().graphs().find(graph);
}

CUresult launch_graph(CUgraphExec graph, CUstream stream, StreamFlavor flavor) {
    const auto on_stream = [&](CUstream on) {
        return OwnTime::in_driver([&] {
            return flavor == StreamFlavor::kPerThread ? real().cuGraphLaunch_ptsz(graph, on)
                                                      : real().cuGraphLaunch(graph, on);
        });
    };
    if (!acts()) return on_stream(stream);
    const OwnTime own_time(CallClass::kLaunch);
    urgengo::runtime::Launch launch;
    launch.graph = graph;
    launch.stream = stream;
    launch.flavor = flavor;
    const std::optional<int> own = own_priority(graph);
    if (!own) return scheduled_on_stream(launch, on_stream);
    launch.asks_priority = true;
    launch.priority = *own;
    const auto as_it_was = [&] {
        // The driver refuses it there.
        if (the_runtime().streams().is_capturing(stream, flavor)) return on_stream(stream);
        const LentPriority lent(launch, *own);
        return on_stream(stream);
    };
    return scheduled_launch(launch, as_it_was, [&](const urgengo::runtime::Grant& grant) {
        return launch_by_stream(launch, grant, on_stream);
    });
}

template <typename Instantiate>
CUresult instantiating(CUgraphExec* executable, CUgraph graph, Instantiate&& instantiate) {
    if (!acts()) return instantiate();
    const OwnTime own_time(CallClass::kOther);
    const Inside inside;
    const CUresult result = OwnTime::in_driver(instantiate);
    if (result == CUDA_SUCCESS)
        protect([&] {
            if (g_some_lack_their_flag.load()) the_runtime().streams().graphs().forget(*executable);
            the_runtime().graph_instantiated(*executable, graph);
        });
    return result;
}

/// @param instantiate  (flags) -> CUresult
template <typename Instantiate>
CUresult instantiating(CUgraphExec* executable, CUgraph graph, unsigned long long flags,
                       Instantiate&& instantiate) {
    std::optional<int> own;
    if ((flags & kNodePriority) != 0 && (flags & kDeviceLaunch) == 0 && acts()) {
        const Inside inside;
        protect([&] { own = the_runtime().launches().replaceable_priority(graph); });
    }
    if (!own) return instantiating(executable, graph, [&] { return instantiate(flags); });
    const CUresult result =
        instantiating(executable, graph, [&] { return instantiate(flags & ~kNodePriority); });
    if (result != CUDA_SUCCESS) return result;
    bool is_kept = false;
    protect([&] {
        is_kept = the_runtime().streams().graphs().keep(*executable, *own);
        if (is_kept) g_some_lack_their_flag.store(true);
    });
    if (is_kept) return result;
    real().cuGraphExecDestroy(*executable);
    return instantiating(executable, graph, [&] { return instantiate(flags); });
}

/// @param call  (CUDA_GRAPH_INSTANTIATE_PARAMS*) -> CUresult
template <typename Call>
CUresult instantiating_with(CUgraphExec* executable, CUgraph graph,
                            CUDA_GRAPH_INSTANTIATE_PARAMS* parameters, Call&& call) {
    if (!parameters) return call(parameters);
    const cuuint64_t flags = parameters->flags;
    return instantiating(executable, graph, flags, [&](unsigned long long those) {
        parameters->flags = those;
        const CUresult result = call(parameters);
        parameters->flags = flags;
        return result;
    });
}

}  // namespace

// cuda.h lets this name stand for the third version.
#undef cuGraphInstantiate
#undef cuGraphInstantiateWithParams
#undef cuGraphLaunch

extern "C" {

CUresult CUDAAPI cuGraphLaunch(CUgraphExec graph, CUstream stream) {
    if (!g_some_lack_their_flag.load(std::memory_order_relaxed)) [[likely]]
        if (const auto* driver = real_if_bystanders_launch(stream))
            return driver->cuGraphLaunch(graph, stream);
    return launch_graph(graph, stream, StreamFlavor::kLegacy);
}

CUresult CUDAAPI cuGraphLaunch_ptsz(CUgraphExec graph, CUstream stream) {
    if (!g_some_lack_their_flag.load(std::memory_order_relaxed)) [[likely]]
        if (const auto* driver = real_if_bystanders_launch(stream))
            return driver->cuGraphLaunch_ptsz(graph, stream);
    return launch_graph(graph, stream, StreamFlavor::kPerThread);
}

CUresult CUDAAPI cuGraphInstantiate(CUgraphExec* executable, CUgraph graph, CUgraphNode* error_node,
                                    char* log, size_t log_bytes) {
    return instantiating(executable, graph, [&] {
        return real().cuGraphInstantiate_v1(executable, graph, error_node, log, log_bytes);
    });
}

CUresult CUDAAPI cuGraphInstantiate_v2(CUgraphExec* executable, CUgraph graph,
                                       CUgraphNode* error_node, char* log, size_t log_bytes) {
    return instantiating(executable, graph, [&] {
        return real().cuGraphInstantiate_v2(executable, graph, error_node, log, log_bytes);
    });
}

CUresult CUDAAPI cuGraphInstantiateWithFlags(CUgraphExec* executable, CUgraph graph,
                                             unsigned long long flags) {
    return instantiating(executable, graph, flags, [&](unsigned long long those) {
        return real().cuGraphInstantiateWithFlags(executable, graph, those);
    });
}

CUresult CUDAAPI cuGraphInstantiateWithParams(CUgraphExec* executable, CUgraph graph,
                                              CUDA_GRAPH_INSTANTIATE_PARAMS* parameters) {
    return instantiating_with(executable, graph, parameters, [&](auto* those) {
        return real().cuGraphInstantiateWithParams(executable, graph, those);
    });
}

CUresult CUDAAPI cuGraphInstantiateWithParams_ptsz(CUgraphExec* executable, CUgraph graph,
                                                   CUDA_GRAPH_INSTANTIATE_PARAMS* parameters) {
    return instantiating_with(executable, graph, parameters, [&](auto* those) {
        return real().cuGraphInstantiateWithParams_ptsz(executable, graph, those);
    });
}

CUresult CUDAAPI cuGraphExecDestroy(CUgraphExec executable) {
    // Before: the handle may be given out again the moment it is free.
    if (acts_already())
        protect([&] {
            the_runtime().kernels().graph_destroyed(executable);
            the_runtime().streams().graphs().forget(executable);
        });
    return real().cuGraphExecDestroy(executable);
}

}  // extern "C"
