// SPDX-License-Identifier: Apache-2.0
//
// Graphs: making them, their dependencies, and looking into them.
#include "tools/simgpu/graph/graph.h"

#include <algorithm>

using namespace urgengo::simgpu;

namespace urgengo::simgpu {

CUgraph make_graph() {
    return driver().graphs.add(std::make_shared<Graph>());
}

void destroy_graph(CUgraph handle) {
    const auto graph = driver().graphs.remove(handle);
    if (!graph) return;
    for (const auto& node : graph->nodes) {
        for (CUgraph child : node->child_handles) destroy_graph(child);
        driver().graph_nodes.remove(reinterpret_cast<CUgraphNode>(node.get()));
    }
}

CUgraphNodeType type_of(const Work& work) {
    struct Type {
        CUgraphNodeType operator()(const KernelWork&) const { return CU_GRAPH_NODE_TYPE_KERNEL; }
        CUgraphNodeType operator()(const CopyWork& copy) const {
            return copy.is_memset ? CU_GRAPH_NODE_TYPE_MEMSET : CU_GRAPH_NODE_TYPE_MEMCPY;
        }
        CUgraphNodeType operator()(const TimedWork& timed) const {
            return timed.run ? CU_GRAPH_NODE_TYPE_BATCH_MEM_OP : CU_GRAPH_NODE_TYPE_EMPTY;
        }
        CUgraphNodeType operator()(const ValueWait&) const {
            return CU_GRAPH_NODE_TYPE_BATCH_MEM_OP;
        }
        CUgraphNodeType operator()(const HostCall&) const { return CU_GRAPH_NODE_TYPE_HOST; }
    };
    return std::visit(Type{}, work);
}

CUgraphNode add_node(Graph& graph, CUgraph graph_handle, GraphNode node) {
    node.graph = graph_handle;
    graph.nodes.push_back(std::make_shared<GraphNode>(std::move(node)));
    return driver().graph_nodes.add(graph.nodes.back());
}

CUresult find_graph(CUgraph handle, std::shared_ptr<Graph>& graph) {
    if (CUresult error = require_init()) return error;
    graph = driver().graphs.find(handle);
    return graph ? CUDA_SUCCESS : CUDA_ERROR_INVALID_VALUE;
}

CUresult find_node(CUgraphNode handle, std::shared_ptr<GraphNode>& node) {
    if (CUresult error = require_init()) return error;
    node = driver().graph_nodes.find(handle);
    return node ? CUDA_SUCCESS : CUDA_ERROR_INVALID_VALUE;
}

}  // namespace urgengo::simgpu

namespace {

/// The driver's way to return a list: a null array asks for the number; more room than there are is
/// filled with nulls, and the number is what was returned.
CUresult give(const std::vector<CUgraphNode>& found, CUgraphNode* nodes, std::size_t* count) {
    if (count == nullptr) return CUDA_ERROR_INVALID_VALUE;
    if (nodes == nullptr) {
        *count = found.size();
        return CUDA_SUCCESS;
    }
    const std::size_t given = std::min(*count, found.size());
    std::fill_n(std::copy_n(found.begin(), given, nodes), *count - given, nullptr);
    *count = given;
    return CUDA_SUCCESS;
}

CUgraphNode handle_of(const std::shared_ptr<GraphNode>& node) {
    return reinterpret_cast<CUgraphNode>(node.get());
}

CUresult get_nodes(CUgraph handle, bool only_roots, CUgraphNode* nodes, std::size_t* count) {
    std::shared_ptr<Graph> graph;
    if (CUresult error = find_graph(handle, graph)) return error;
    std::vector<CUgraphNode> found;
    for (const auto& node : graph->nodes) {
        if (!only_roots || node->dependencies.empty()) found.push_back(handle_of(node));
    }
    return give(found, nodes, count);
}

CUresult add_dependencies(CUgraph handle, const CUgraphNode* from, const CUgraphNode* to,
                          std::size_t count) {
    std::shared_ptr<Graph> graph;
    if (CUresult error = find_graph(handle, graph)) return error;
    if (count > 0 && (from == nullptr || to == nullptr)) return CUDA_ERROR_INVALID_VALUE;
    const auto is_in_graph = [handle](CUgraphNode node) {
        const auto found = driver().graph_nodes.find(node);
        return found && found->graph == handle;
    };
    for (std::size_t i = 0; i < count; ++i) {
        if (from[i] == to[i] || !is_in_graph(from[i]) || !is_in_graph(to[i])) {
            return CUDA_ERROR_INVALID_VALUE;
        }
        const auto& known = driver().graph_nodes.find(to[i])->dependencies;
        if (std::find(known.begin(), known.end(), from[i]) != known.end()) {
            return CUDA_ERROR_INVALID_VALUE;  // an edge is there once
        }
    }
    for (std::size_t i = 0; i < count; ++i) {
        driver().graph_nodes.find(to[i])->dependencies.push_back(from[i]);
    }
    return CUDA_SUCCESS;
}

}  // namespace

SIMGPU_API CUresult cuGraphCreate(CUgraph* graph, unsigned flags) {
    if (CUresult error = require_init()) return error;
    if (graph == nullptr || flags != 0) return CUDA_ERROR_INVALID_VALUE;
    *graph = make_graph();
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuGraphDestroy(CUgraph handle) {
    std::shared_ptr<Graph> graph;
    if (CUresult error = find_graph(handle, graph)) return error;
    destroy_graph(handle);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuGraphDestroyNode(CUgraphNode handle) {
    std::shared_ptr<GraphNode> node;
    if (CUresult error = find_node(handle, node)) return error;
    const auto graph = driver().graphs.find(node->graph);
    if (!graph) return CUDA_ERROR_INVALID_VALUE;
    for (CUgraph child : node->child_handles) destroy_graph(child);
    for (const auto& other : graph->nodes) std::erase(other->dependencies, handle);
    std::erase(graph->nodes, node);
    driver().graph_nodes.remove(handle);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuGraphGetNodes(CUgraph graph, CUgraphNode* nodes, std::size_t* count) {
    return get_nodes(graph, false, nodes, count);
}

SIMGPU_API CUresult cuGraphGetRootNodes(CUgraph graph, CUgraphNode* nodes, std::size_t* count) {
    return get_nodes(graph, true, nodes, count);
}

SIMGPU_API CUresult cuGraphNodeGetType(CUgraphNode handle, CUgraphNodeType* type) {
    std::shared_ptr<GraphNode> node;
    if (CUresult error = find_node(handle, node)) return error;
    if (type == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *type = node->type;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuGraphNodeGetDependencies(CUgraphNode handle, CUgraphNode* dependencies,
                                               std::size_t* count) {
    std::shared_ptr<GraphNode> node;
    if (CUresult error = find_node(handle, node)) return error;
    return give(node->dependencies, dependencies, count);
}

SIMGPU_API CUresult cuGraphNodeGetDependencies_v2(CUgraphNode handle, CUgraphNode* dependencies,
                                                  CUgraphEdgeData* edges, std::size_t* count) {
    const CUresult result = cuGraphNodeGetDependencies(handle, dependencies, count);
    if (result == CUDA_SUCCESS && dependencies != nullptr && edges != nullptr) {
        std::fill_n(edges, *count, CUgraphEdgeData{});
    }
    return result;
}

SIMGPU_API CUresult cuGraphAddDependencies(CUgraph graph, const CUgraphNode* from,
                                           const CUgraphNode* to, std::size_t count) {
    return add_dependencies(graph, from, to, count);
}

SIMGPU_API CUresult cuGraphAddDependencies_v2(CUgraph graph, const CUgraphNode* from,
                                              const CUgraphNode* to, const CUgraphEdgeData* edges,
                                              std::size_t count) {
    for (std::size_t i = 0; edges != nullptr && i < count; ++i) {
        // Programmatic edges are not modelled.
        if (edges[i].type != CU_GRAPH_DEPENDENCY_TYPE_DEFAULT) return CUDA_ERROR_NOT_SUPPORTED;
    }
    return add_dependencies(graph, from, to, count);
}
