// SPDX-License-Identifier: Apache-2.0
//
// Nodes that allocate and free memory. The address is fixed when the node is made; allocating takes
// no time.
#include "tools/simgpu/graph/graph.h"

using namespace urgengo::simgpu;

namespace urgengo::simgpu {

CUresult make_alloc_node(Context& context, std::size_t bytes, GraphNode& node) {
    if (bytes == 0) return CUDA_ERROR_INVALID_VALUE;
    Driver& state = driver();
    const auto base = state.memory.allocate(Allocation::Kind::kDevice, bytes, 0, &context,
                                            context.device, state.part.memory_bytes);
    if (!base) return CUDA_ERROR_OUT_OF_MEMORY;
    node.type = CU_GRAPH_NODE_TYPE_MEM_ALLOC;
    node.memory = std::make_shared<GraphMemory>(*base);
    state.memory.give_to_graph(*base, node.memory->in_use);
    return CUDA_SUCCESS;
}

CUresult make_free_node(CUdeviceptr pointer, GraphNode& node) {
    const auto allocation = driver().memory.find(pointer);
    const bool is_graphs = allocation && allocation->base == pointer && allocation->graph_uses;
    if (!is_graphs) return CUDA_ERROR_INVALID_VALUE;
    node.type = CU_GRAPH_NODE_TYPE_MEM_FREE;
    node.freed = pointer;
    return CUDA_SUCCESS;
}

}  // namespace urgengo::simgpu

SIMGPU_API CUresult cuGraphAddMemAllocNode(CUgraphNode* handle, CUgraph graph,
                                           const CUgraphNode* dependencies,
                                           std::size_t num_dependencies,
                                           CUDA_MEM_ALLOC_NODE_PARAMS* params) {
    if (params == nullptr) return CUDA_ERROR_INVALID_VALUE;
    Context* context = nullptr;
    if (CUresult error = current_context(context)) return error;
    const CUmemPoolProps& props = params->poolProps;
    const bool possible = props.allocType == CU_MEM_ALLOCATION_TYPE_PINNED &&
                          props.handleTypes == CU_MEM_HANDLE_TYPE_NONE &&
                          props.location.type == CU_MEM_LOCATION_TYPE_DEVICE &&
                          props.location.id == context->device;
    if (!possible) return CUDA_ERROR_INVALID_VALUE;
    GraphNode node;
    if (CUresult error = make_alloc_node(*context, params->bytesize, node)) return error;
    params->dptr = node.memory->base;
    return add_node_checked(handle, graph, dependencies, num_dependencies, std::move(node));
}

SIMGPU_API CUresult cuGraphAddMemFreeNode(CUgraphNode* handle, CUgraph graph,
                                          const CUgraphNode* dependencies,
                                          std::size_t num_dependencies, CUdeviceptr pointer) {
    if (CUresult error = require_init()) return error;
    GraphNode node;
    if (CUresult error = make_free_node(pointer, node)) return error;
    return add_node_checked(handle, graph, dependencies, num_dependencies, std::move(node));
}
