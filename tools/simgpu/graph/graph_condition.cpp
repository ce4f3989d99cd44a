// SPDX-License-Identifier: Apache-2.0
//
// Conditional nodes. No simulated kernel sets a condition, so all that is known of one is its
// default value; graph_layout.cpp says what follows.
#include <map>

#include "tools/simgpu/graph/graph.h"

using namespace urgengo::simgpu;

namespace {

struct Condition {
    CUgraph graph;
    unsigned default_value;
    bool assigns_default;
};

std::mutex g_mutex;
std::map<std::uint64_t, Condition> g_conditions;

CUresult add_conditional(CUgraphNode* handle, CUgraph graph, const CUgraphNode* dependencies,
                         std::size_t num_dependencies, CUDA_CONDITIONAL_NODE_PARAMS& params) {
    {
        std::lock_guard lock(g_mutex);
        const auto found = g_conditions.find(params.handle);
        if (found == g_conditions.end() || found->second.graph != graph) {
            return CUDA_ERROR_INVALID_VALUE;
        }
    }
    const unsigned most = params.type == CU_GRAPH_COND_TYPE_WHILE ? 1
                          : params.type == CU_GRAPH_COND_TYPE_IF  ? 2
                                                                  : ~0U;
    if (params.size == 0 || params.size > most) return CUDA_ERROR_INVALID_VALUE;
    GraphNode node;
    node.type = CU_GRAPH_NODE_TYPE_CONDITIONAL;
    node.condition = params.handle;
    node.condition_type = params.type;
    for (unsigned i = 0; i < params.size; ++i) {
        node.children.push_back(std::make_shared<Graph>());
        node.child_handles.push_back(driver().graphs.add(node.children.back()));
    }
    if (CUresult error =
            add_node_checked(handle, graph, dependencies, num_dependencies, std::move(node))) {
        return error;
    }
    // The array is the driver's, and lives as long as the node.
    params.phGraph_out = driver().graph_nodes.find(*handle)->child_handles.data();
    return CUDA_SUCCESS;
}

}  // namespace

namespace urgengo::simgpu {

std::optional<unsigned> launch_value(std::uint64_t condition) {
    std::lock_guard lock(g_mutex);
    const auto found = g_conditions.find(condition);
    if (found == g_conditions.end() || !found->second.assigns_default) return std::nullopt;
    return found->second.default_value;
}

}  // namespace urgengo::simgpu

SIMGPU_API CUresult cuGraphConditionalHandleCreate(CUgraphConditionalHandle* handle, CUgraph graph,
                                                   CUcontext context, unsigned default_value,
                                                   unsigned flags) {
    std::shared_ptr<Graph> found;
    if (CUresult error = find_graph(graph, found)) return error;
    const bool known = (flags & ~unsigned{CU_GRAPH_COND_ASSIGN_DEFAULT}) == 0;
    if (handle == nullptr || !known) return CUDA_ERROR_INVALID_VALUE;
    std::lock_guard lock(g_mutex);
    *handle = driver().next_id++;
    g_conditions[*handle] = {graph, default_value, (flags & CU_GRAPH_COND_ASSIGN_DEFAULT) != 0};
    return CUDA_SUCCESS;
}

/// Only the kinds that have no function of their own, and the child graph.
SIMGPU_API CUresult cuGraphAddNode_v2(CUgraphNode* node, CUgraph graph,
                                      const CUgraphNode* dependencies, const CUgraphEdgeData* edges,
                                      std::size_t num_dependencies, CUgraphNodeParams* params) {
    if (CUresult error = require_init()) return error;
    if (node == nullptr || params == nullptr) return CUDA_ERROR_INVALID_VALUE;
    for (std::size_t i = 0; edges != nullptr && i < num_dependencies; ++i) {
        if (edges[i].type != CU_GRAPH_DEPENDENCY_TYPE_DEFAULT) return CUDA_ERROR_NOT_SUPPORTED;
    }
    switch (params->type) {
        case CU_GRAPH_NODE_TYPE_CONDITIONAL:
            return add_conditional(node, graph, dependencies, num_dependencies,
                                   params->conditional);
        case CU_GRAPH_NODE_TYPE_EMPTY:
            return add_node_checked(node, graph, dependencies, num_dependencies, {});
        case CU_GRAPH_NODE_TYPE_GRAPH:
            return cuGraphAddChildGraphNode(node, graph, dependencies, num_dependencies,
                                            params->graph.graph);
        default:
            return CUDA_ERROR_NOT_SUPPORTED;
    }
}

SIMGPU_API CUresult cuGraphAddNode(CUgraphNode* node, CUgraph graph,
                                   const CUgraphNode* dependencies, std::size_t num_dependencies,
                                   CUgraphNodeParams* params) {
    return cuGraphAddNode_v2(node, graph, dependencies, nullptr, num_dependencies, params);
}
