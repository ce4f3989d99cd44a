// SPDX-License-Identifier: Apache-2.0
//
// Changing executable graphs: single nodes, and all of them after another graph.
#include <algorithm>

#include "tools/simgpu/graph/graph.h"

using namespace urgengo::simgpu;

namespace {

CUresult find_exec(CUgraphExec handle, std::shared_ptr<GraphExec>& exec) {
    if (CUresult error = require_init()) return error;
    exec = driver().graph_execs.find(handle);
    return exec ? CUDA_SUCCESS : CUDA_ERROR_INVALID_VALUE;
}

/// @returns null if the executable graph has no such node
ExecNode* find_node_of(GraphExec& exec, CUgraphNode source) {
    const auto found = std::find_if(
        exec.nodes.begin(), exec.nodes.end(),
        [source](const ExecNode& node) { return node.source == source && source != nullptr; });
    return found == exec.nodes.end() ? nullptr : &*found;
}

/// @returns why the one cannot become the other, and at which node
CUgraphExecUpdateResult compare(const GraphExec& exec, const GraphExec& wanted,
                                CUgraphNode& error_node) {
    if (exec.nodes.size() != wanted.nodes.size()) {
        return CU_GRAPH_EXEC_UPDATE_ERROR_TOPOLOGY_CHANGED;
    }
    for (std::size_t i = 0; i < exec.nodes.size(); ++i) {
        const GraphNode& is = *exec.nodes[i].node;
        const GraphNode& shall_be = *wanted.nodes[i].node;
        error_node = wanted.nodes[i].source;
        if (exec.nodes[i].dependencies != wanted.nodes[i].dependencies) {
            return CU_GRAPH_EXEC_UPDATE_ERROR_TOPOLOGY_CHANGED;
        }
        if (is.type != shall_be.type) return CU_GRAPH_EXEC_UPDATE_ERROR_NODE_TYPE_CHANGED;
        if (is.memory != shall_be.memory || is.freed != shall_be.freed ||
            is.condition != shall_be.condition) {
            return CU_GRAPH_EXEC_UPDATE_ERROR_PARAMETERS_CHANGED;
        }
    }
    error_node = nullptr;
    return CU_GRAPH_EXEC_UPDATE_SUCCESS;
}

CUresult update(CUgraphExec handle, CUgraph graph_handle, CUgraphExecUpdateResultInfo& info) {
    info = {CU_GRAPH_EXEC_UPDATE_ERROR, nullptr, nullptr};
    std::shared_ptr<GraphExec> exec;
    std::shared_ptr<Graph> graph;
    if (CUresult error = find_exec(handle, exec)) return error;
    if (CUresult error = find_graph(graph_handle, graph)) return error;
    GraphExec wanted;
    if (CUresult error = lay_out(*graph, wanted)) return error;
    std::lock_guard lock(exec->mutex);
    info.result = compare(*exec, wanted, info.errorNode);
    if (info.result != CU_GRAPH_EXEC_UPDATE_SUCCESS) return CUDA_ERROR_GRAPH_EXEC_UPDATE_FAILURE;
    for (std::size_t i = 0; i < exec->nodes.size(); ++i) {
        exec->nodes[i].node = wanted.nodes[i].node;
    }
    return CUDA_SUCCESS;
}

}  // namespace

SIMGPU_API CUresult cuGraphExecUpdate_v2(CUgraphExec exec, CUgraph graph,
                                         CUgraphExecUpdateResultInfo* info) {
    if (info == nullptr) return CUDA_ERROR_INVALID_VALUE;
    return update(exec, graph, *info);
}

SIMGPU_API CUresult cuGraphExecUpdate(CUgraphExec exec, CUgraph graph, CUgraphNode* error_node,
                                      CUgraphExecUpdateResult* result) {
    CUgraphExecUpdateResultInfo info{};
    const CUresult returned = update(exec, graph, info);
    if (error_node != nullptr) *error_node = info.errorNode;
    if (result != nullptr) *result = info.result;
    return returned;
}

SIMGPU_API CUresult cuGraphExecKernelNodeSetParams_v2(CUgraphExec handle, CUgraphNode source,
                                                      const CUDA_KERNEL_NODE_PARAMS_v2* params) {
    std::shared_ptr<GraphExec> exec;
    if (CUresult error = find_exec(handle, exec)) return error;
    std::lock_guard lock(exec->mutex);
    ExecNode* const found = find_node_of(*exec, source);
    if (params == nullptr || found == nullptr) return CUDA_ERROR_INVALID_VALUE;
    GraphNode& node = *found->node;
    const auto* const kernel = std::get_if<KernelWork>(&node.work);
    if (kernel == nullptr) return CUDA_ERROR_INVALID_VALUE;
    return prepare_kernel_node(*params, kernel->priority, node.work, node.kernel);
}

SIMGPU_API CUresult cuGraphExecKernelNodeSetParams(CUgraphExec handle, CUgraphNode source,
                                                   const CUDA_KERNEL_NODE_PARAMS_v1* params) {
    if (params == nullptr) return CUDA_ERROR_INVALID_VALUE;
    const CUDA_KERNEL_NODE_PARAMS_v2 wide = widen(*params);
    return cuGraphExecKernelNodeSetParams_v2(handle, source, &wide);
}

SIMGPU_API CUresult cuGraphNodeSetEnabled(CUgraphExec handle, CUgraphNode source,
                                          unsigned is_enabled) {
    std::shared_ptr<GraphExec> exec;
    if (CUresult error = find_exec(handle, exec)) return error;
    std::lock_guard lock(exec->mutex);
    ExecNode* const node = find_node_of(*exec, source);
    if (node == nullptr) return CUDA_ERROR_INVALID_VALUE;
    const CUgraphNodeType type = node->node->type;
    const bool possible = type == CU_GRAPH_NODE_TYPE_KERNEL || type == CU_GRAPH_NODE_TYPE_MEMCPY ||
                          type == CU_GRAPH_NODE_TYPE_MEMSET;
    if (!possible) return CUDA_ERROR_INVALID_VALUE;
    node->is_enabled = is_enabled != 0;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuGraphNodeGetEnabled(CUgraphExec handle, CUgraphNode source,
                                          unsigned* is_enabled) {
    std::shared_ptr<GraphExec> exec;
    if (CUresult error = find_exec(handle, exec)) return error;
    std::lock_guard lock(exec->mutex);
    const ExecNode* const node = find_node_of(*exec, source);
    if (node == nullptr || is_enabled == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *is_enabled = node->is_enabled ? 1 : 0;
    return CUDA_SUCCESS;
}
