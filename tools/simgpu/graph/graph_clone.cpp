// SPDX-License-Identifier: Apache-2.0
//
// Copies of graphs: clones, and the child graphs that nodes own.
#include <unordered_map>

#include "tools/simgpu/graph/graph.h"

using namespace urgengo::simgpu;

namespace urgengo::simgpu {

std::shared_ptr<Graph> clone_graph(const Graph& graph) {
    auto clone = std::make_shared<Graph>();
    std::unordered_map<CUgraphNode, CUgraphNode> copies;
    for (const auto& node : graph.nodes) {
        const auto& copy = clone->nodes.emplace_back(std::make_shared<GraphNode>(*node));
        copy->graph = nullptr;
        copy->original = reinterpret_cast<CUgraphNode>(node.get());
        copy->child_handles.clear();
        for (auto& child : copy->children) child = clone_graph(*child);
        copies[copy->original] = reinterpret_cast<CUgraphNode>(copy.get());
    }
    for (const auto& copy : clone->nodes)
        for (CUgraphNode& dependency : copy->dependencies) dependency = copies.at(dependency);
    return clone;
}

CUgraph register_graph(const std::shared_ptr<Graph>& graph) {
    const CUgraph handle = driver().graphs.add(graph);
    for (const auto& node : graph->nodes) {
        node->graph = handle;
        driver().graph_nodes.add(node);
        for (const auto& child : node->children)
            node->child_handles.push_back(register_graph(child));
    }
    return handle;
}

GraphNode make_child_node(const Graph& graph) {
    GraphNode node;
    node.type = CU_GRAPH_NODE_TYPE_GRAPH;
    node.children = {clone_graph(graph)};
    node.child_handles = {register_graph(node.children.front())};
    return node;
}

}  // namespace urgengo::simgpu

SIMGPU_API CUresult cuGraphClone(CUgraph* clone, CUgraph handle) {
    std::shared_ptr<Graph> graph;
    if (CUresult error = find_graph(handle, graph)) return error;
    if (clone == nullptr) return CUDA_ERROR_INVALID_VALUE;
    for (const auto& node : graph->nodes) {
        const bool is_memory =
            node->type == CU_GRAPH_NODE_TYPE_MEM_ALLOC || node->type == CU_GRAPH_NODE_TYPE_MEM_FREE;
        if (is_memory) return CUDA_ERROR_NOT_SUPPORTED;
    }
    *clone = register_graph(clone_graph(*graph));
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuGraphNodeFindInClone(CUgraphNode* found, CUgraphNode original,
                                           CUgraph clone) {
    std::shared_ptr<Graph> graph;
    if (CUresult error = find_graph(clone, graph)) return error;
    if (found == nullptr) return CUDA_ERROR_INVALID_VALUE;
    for (const auto& node : graph->nodes) {
        if (node->original != original || original == nullptr) continue;
        *found = reinterpret_cast<CUgraphNode>(node.get());
        return CUDA_SUCCESS;
    }
    return CUDA_ERROR_INVALID_VALUE;
}

SIMGPU_API CUresult cuGraphAddChildGraphNode(CUgraphNode* node, CUgraph graph_handle,
                                             const CUgraphNode* dependencies,
                                             std::size_t num_dependencies, CUgraph child_handle) {
    std::shared_ptr<Graph> child;
    if (CUresult error = find_graph(child_handle, child)) return error;
    if (child_handle == graph_handle) return CUDA_ERROR_INVALID_VALUE;
    return add_node_checked(node, graph_handle, dependencies, num_dependencies,
                            make_child_node(*child));
}

SIMGPU_API CUresult cuGraphChildGraphNodeGetGraph(CUgraphNode handle, CUgraph* graph) {
    std::shared_ptr<GraphNode> node;
    if (CUresult error = find_node(handle, node)) return error;
    if (graph == nullptr || node->type != CU_GRAPH_NODE_TYPE_GRAPH) return CUDA_ERROR_INVALID_VALUE;
    *graph = node->child_handles.front();
    return CUDA_SUCCESS;
}
