// SPDX-License-Identifier: Apache-2.0
//
// Executable graphs: made, and launched. Of the lanes on which their nodes lie (graph_layout.cpp),
// lane 0 is the stream of the launch; the others are streams of this one launch, between two points
// of it.
#include <algorithm>

#include "tools/simgpu/api/launch.h"
#include "tools/simgpu/api/launch_call.h"
#include "tools/simgpu/graph/capture.h"
#include "tools/simgpu/graph/graph.h"

namespace urgengo::simgpu {
namespace {

constexpr cuuint64_t kKnownFlags =
    CUDA_GRAPH_INSTANTIATE_FLAG_AUTO_FREE_ON_LAUNCH | CUDA_GRAPH_INSTANTIATE_FLAG_UPLOAD |
    CUDA_GRAPH_INSTANTIATE_FLAG_DEVICE_LAUNCH | CUDA_GRAPH_INSTANTIATE_FLAG_USE_NODE_PRIORITY;

CUresult instantiate(CUgraphExec* handle, CUgraph graph_handle, cuuint64_t flags) {
    Context* context = nullptr;
    if (CUresult error = current_context(context)) return error;
    const auto graph = driver().graphs.find(graph_handle);
    if (handle == nullptr || !graph || (flags & ~kKnownFlags) != 0) return CUDA_ERROR_INVALID_VALUE;
    // Kernels here cannot launch graphs; that they might is only accepted, under its conditions.
    const bool from_device = (flags & CUDA_GRAPH_INSTANTIATE_FLAG_DEVICE_LAUNCH) != 0;
    const bool auto_free = (flags & CUDA_GRAPH_INSTANTIATE_FLAG_AUTO_FREE_ON_LAUNCH) != 0;
    if (from_device && auto_free) return CUDA_ERROR_INVALID_VALUE;
    auto exec = std::make_shared<GraphExec>();
    exec->context = context;
    exec->flags = flags;
    exec->graph = clone_graph(*graph);
    if (CUresult error = lay_out(*graph, *exec)) return error;
    for (const ExecNode& node : exec->nodes) {
        const CUgraphNodeType type = node.node->type;
        const bool only_from_host =
            type == CU_GRAPH_NODE_TYPE_HOST || type == CU_GRAPH_NODE_TYPE_MEM_ALLOC ||
            type == CU_GRAPH_NODE_TYPE_MEM_FREE || type == CU_GRAPH_NODE_TYPE_BATCH_MEM_OP;
        if (from_device && only_from_host) return CUDA_ERROR_NOT_SUPPORTED;
    }
    *handle = driver().graph_execs.add(std::move(exec));
    return CUDA_SUCCESS;
}

/// Allocates and frees as the graph's nodes say.
/// @returns CUDA_ERROR_INVALID_VALUE if the program still has what an earlier launch allocated
CUresult take_memory(const GraphExec& exec) {
    const bool auto_free = (exec.flags & CUDA_GRAPH_INSTANTIATE_FLAG_AUTO_FREE_ON_LAUNCH) != 0;
    for (const ExecNode& node : exec.nodes) {
        const auto& memory = node.node->memory;
        if (memory && *memory->in_use && !auto_free) return CUDA_ERROR_INVALID_VALUE;
    }
    for (const ExecNode& node : exec.nodes) {
        if (node.node->memory) *node.node->memory->in_use = true;
        if (node.node->freed == 0) continue;
        const auto allocation = driver().memory.find(node.node->freed);
        if (allocation && allocation->graph_uses) *allocation->graph_uses = false;
    }
    return CUDA_SUCCESS;
}

}  // namespace

CUresult launch_graph(GraphExec& exec, Stream& stream) {
    std::lock_guard lock(exec.mutex);
    if (CUresult error = take_memory(exec)) return error;
    const bool own_priorities = (exec.flags & CUDA_GRAPH_INSTANTIATE_FLAG_USE_NODE_PRIORITY) != 0;
    const int stream_priority = stream.priority;
    const Fence begin = submit(stream, TimedWork{}, {exec.last_end});
    std::vector<std::shared_ptr<StreamQueue>> lanes{stream.queue};
    while (lanes.size() < exec.num_lanes) {
        lanes.push_back(std::make_shared<StreamQueue>(stream.queue->id,
                                                      StreamQueue::Kind::kNonBlocking,
                                                      stream.queue->group, stream.queue->device));
    }
    std::vector<Fence> ends;
    for (const ExecNode& node : exec.nodes) {
        Work work = node.is_enabled ? node.node->work : TimedWork{};
        auto* const kernel = std::get_if<KernelWork>(&work);
        if (kernel != nullptr && !own_priorities) kernel->priority = stream_priority;
        if (kernel != nullptr) kernel->launch = LaunchCall::current();
        std::vector<Fence> fences;
        if (node.lane != 0) fences.push_back(begin);
        for (const std::size_t place : node.other_dependencies) fences.push_back(ends[place]);
        ends.push_back(submit_to(lanes[node.lane], std::move(work), std::move(fences)));
    }
    std::vector<Fence> leaves;
    for (const std::size_t place : exec.leaves) leaves.push_back(ends[place]);
    exec.last_end = submit(stream, TimedWork{}, std::move(leaves));
    return CUDA_SUCCESS;
}

}  // namespace urgengo::simgpu

using namespace urgengo::simgpu;

namespace {

CUresult find_exec(CUgraphExec handle, std::shared_ptr<GraphExec>& exec) {
    if (CUresult error = require_init()) return error;
    exec = driver().graph_execs.find(handle);
    return exec ? CUDA_SUCCESS : CUDA_ERROR_INVALID_VALUE;
}

}  // namespace

SIMGPU_API CUresult cuGraphInstantiateWithFlags(CUgraphExec* exec, CUgraph graph,
                                                unsigned long long flags) {
    return instantiate(exec, graph, flags);
}

SIMGPU_API CUresult cuGraphInstantiate(CUgraphExec* exec, CUgraph graph, CUgraphNode* error_node,
                                       char* log, std::size_t log_bytes) {
    if (error_node != nullptr) *error_node = nullptr;
    if (log != nullptr && log_bytes > 0) *log = '\0';
    return instantiate(exec, graph, 0);
}

SIMGPU_API CUresult cuGraphInstantiate_v2(CUgraphExec* exec, CUgraph graph, CUgraphNode* error_node,
                                          char* log, std::size_t log_bytes) {
    return cuGraphInstantiate(exec, graph, error_node, log, log_bytes);
}

SIMGPU_API CUresult cuGraphInstantiateWithParams(CUgraphExec* exec, CUgraph graph,
                                                 CUDA_GRAPH_INSTANTIATE_PARAMS* params) {
    if (params == nullptr) return CUDA_ERROR_INVALID_VALUE;
    params->hErrNode_out = nullptr;
    const CUresult result = instantiate(exec, graph, params->flags);
    params->result_out =
        result == CUDA_SUCCESS ? CUDA_GRAPH_INSTANTIATE_SUCCESS : CUDA_GRAPH_INSTANTIATE_ERROR;
    return result;
}

SIMGPU_API CUresult cuGraphExecGetFlags(CUgraphExec handle, cuuint64_t* flags) {
    std::shared_ptr<GraphExec> exec;
    if (CUresult error = find_exec(handle, exec)) return error;
    if (flags == nullptr) return CUDA_ERROR_INVALID_VALUE;
    // As driver 580 answers (measured, H200).
    *flags = exec->flags & ~cuuint64_t{CUDA_GRAPH_INSTANTIATE_FLAG_UPLOAD |
                                       CUDA_GRAPH_INSTANTIATE_FLAG_USE_NODE_PRIORITY};
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuGraphExecDestroy(CUgraphExec handle) {
    if (CUresult error = require_init()) return error;
    return driver().graph_execs.remove(handle) ? CUDA_SUCCESS : CUDA_ERROR_INVALID_VALUE;
}

SIMGPU_API CUresult cuGraphUpload(CUgraphExec handle, CUstream stream_handle) {
    std::shared_ptr<GraphExec> exec;
    if (CUresult error = find_exec(handle, exec)) return error;
    std::shared_ptr<Stream> stream;
    return resolve_stream_for_work(stream_handle, stream);  // there is nowhere to upload it to
}

SIMGPU_API CUresult cuGraphLaunch(CUgraphExec handle, CUstream stream_handle) {
    const LaunchCall call;
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream_for_work(stream_handle, stream)) return error;
    std::shared_ptr<GraphExec> exec;
    if (CUresult error = find_exec(handle, exec)) return error;
    // As measured: H200, driver 580.159.04.
    if (CUresult error = refuse_if_capturing(*stream)) return error;
    return launch_graph(*exec, *stream);
}
