// SPDX-License-Identifier: Apache-2.0
//
// Graphs. A launched graph is one unit: held as one, at one priority (its stream's, lent for the
// launch; nodes that were instantiated with priorities of their own keep them), followed by a mark.
// What is in it is looked at when it is instantiated, so that profiles know it by name.
#include "interposer/manual/launch.h"
#include "interposer/own_time.h"
#include "interposer/real_driver.h"

using namespace urgengo::interposer;
using urgengo::exec::StreamFlavor;

namespace {

CUresult launch_graph(CUgraphExec graph, CUstream stream, StreamFlavor flavor) {
    const auto on_stream = [&](CUstream on) {
        return flavor == StreamFlavor::kPerThread ? real().cuGraphLaunch_ptsz(graph, on)
                                                  : real().cuGraphLaunch(graph, on);
    };
    if (!acts()) return on_stream(stream);
    const OwnTime own_time(CallClass::kLaunch);
    urgengo::runtime::Launch launch;
    launch.graph = graph;
    launch.stream = stream;
    launch.flavor = flavor;
    return scheduled_on_stream(
        launch, [&](CUstream on) { return OwnTime::in_driver([&] { return on_stream(on); }); });
}

template <typename Instantiate>
CUresult instantiating(CUgraphExec* executable, CUgraph graph, Instantiate&& instantiate) {
    if (!acts()) return instantiate();
    const OwnTime own_time(CallClass::kOther);
    const Inside inside;
    const CUresult result = OwnTime::in_driver(instantiate);
    if (result == CUDA_SUCCESS)
        protect([&] { the_runtime().graph_instantiated(*executable, graph); });
    return result;
}

}  // namespace

// cuda.h lets this name stand for the third version.
#undef cuGraphInstantiate
#undef cuGraphInstantiateWithParams
#undef cuGraphLaunch

extern "C" {

CUresult CUDAAPI cuGraphLaunch(CUgraphExec graph, CUstream stream) {
    if (const auto* driver = real_if_bystanders_launch(stream))
        return driver->cuGraphLaunch(graph, stream);
    return launch_graph(graph, stream, StreamFlavor::kLegacy);
}

CUresult CUDAAPI cuGraphLaunch_ptsz(CUgraphExec graph, CUstream stream) {
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
    return instantiating(executable, graph, [&] {
        return real().cuGraphInstantiateWithFlags(executable, graph, flags);
    });
}

CUresult CUDAAPI cuGraphInstantiateWithParams(CUgraphExec* executable, CUgraph graph,
                                              CUDA_GRAPH_INSTANTIATE_PARAMS* parameters) {
    return instantiating(executable, graph, [&] {
        return real().cuGraphInstantiateWithParams(executable, graph, parameters);
    });
}

CUresult CUDAAPI cuGraphInstantiateWithParams_ptsz(CUgraphExec* executable, CUgraph graph,
                                                   CUDA_GRAPH_INSTANTIATE_PARAMS* parameters) {
    return instantiating(executable, graph, [&] {
        return real().cuGraphInstantiateWithParams_ptsz(executable, graph, parameters);
    });
}

CUresult CUDAAPI cuGraphExecDestroy(CUgraphExec executable) {
    // Before: the handle may be given out again the moment it is free.
    if (acts_already()) protect([&] { the_runtime().kernels().graph_destroyed(executable); });
    return real().cuGraphExecDestroy(executable);
}

}  // extern "C"
