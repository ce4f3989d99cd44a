// SPDX-License-Identifier: Apache-2.0
//
// What scenarios of captures and graphs share.
#pragma once

#include <vector>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {

inline std::size_t num_nodes(CUgraph graph) {
    std::size_t count = 0;
    SHOW(cuGraphGetNodes(graph, nullptr, &count));
    return count;
}

/// What each node is, and at which priority it was captured.
inline void say_nodes(CUgraph graph) {
    std::vector<CUgraphNode> nodes(num_nodes(graph));
    std::size_t count = nodes.size();
    MUST(cuGraphGetNodes(graph, nodes.data(), &count));
    for (CUgraphNode node : nodes) {
        CUgraphNodeType type{};
        std::size_t num_dependencies = 0;
        CUkernelNodeAttrValue value{};
        MUST(cuGraphNodeGetType(node, &type));
        MUST(cuGraphNodeGetDependencies(node, nullptr, nullptr, &num_dependencies));
        if (type == CU_GRAPH_NODE_TYPE_KERNEL)
            MUST(cuGraphKernelNodeGetAttribute(node, CU_LAUNCH_ATTRIBUTE_PRIORITY, &value));
        say("node of type %d after %zu, priority %d", int(type), num_dependencies, value.priority);
    }
}

inline CUgraphExec instantiate(CUgraph graph, unsigned long long flags = 0) {
    CUgraphExec exec = nullptr;
    MUST(cuGraphInstantiateWithFlags(&exec, graph, flags));
    return exec;
}

inline void say_priority(CUstream stream) {
    int priority = 99;
    CUstreamAttrValue value{};
    SHOW(cuStreamGetPriority(stream, &priority));
    MUST(cuStreamGetAttribute(stream, CU_LAUNCH_ATTRIBUTE_PRIORITY, &value));
    say("stream's priority %d %d", priority, value.priority);
}

/// A graph of two kernels and a store of `value`, captured on the stream.
inline CUgraph capture(const Gpu& gpu, CUstream stream, std::uint64_t* to, std::uint64_t value,
                       CUstreamCaptureMode mode = CU_STREAM_CAPTURE_MODE_RELAXED) {
    CUgraph graph = nullptr;
    MUST(cuStreamBeginCapture(stream, mode));
    MUST(launch_wide(gpu.wide, stream));
    MUST(launch_store(gpu.store, to, value, stream));
    MUST(launch_tiny(gpu.tiny, stream));
    MUST(cuStreamEndCapture(stream, &graph));
    return graph;
}

}  // namespace twin
