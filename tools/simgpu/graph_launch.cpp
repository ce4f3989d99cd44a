// SPDX-License-Identifier: Apache-2.0
//
// Executable graphs. Instantiation lays the nodes out on lanes: a node goes on the lane of a
// dependency that it is the first to follow, else on a new one. Lane 0 is the stream of the launch;
// the others are streams of this one launch, between two points of it.
#include <algorithm>
#include <unordered_map>

#include "tools/simgpu/capture.h"
#include "tools/simgpu/graph.h"
#include "tools/simgpu/launch.h"

namespace urgengo::simgpu {
namespace {

constexpr cuuint64_t kKnownFlags = CUDA_GRAPH_INSTANTIATE_FLAG_AUTO_FREE_ON_LAUNCH |
                                   CUDA_GRAPH_INSTANTIATE_FLAG_UPLOAD |
                                   CUDA_GRAPH_INSTANTIATE_FLAG_USE_NODE_PRIORITY;

/// @returns the nodes with dependencies first; fewer than there are if there is a cycle
std::vector<std::shared_ptr<GraphNode>> in_order(const Graph& graph) {
    std::vector<std::shared_ptr<GraphNode>> sorted;
    std::vector<std::shared_ptr<GraphNode>> left = graph.nodes;
    std::unordered_map<CUgraphNode, bool> placed;
    for (bool progress = true; progress;) {
        progress = false;
        for (auto& node : left) {
            const bool ready =
                node && std::all_of(node->dependencies.begin(), node->dependencies.end(),
                                    [&placed](CUgraphNode other) { return placed[other]; });
            if (!ready) continue;
            placed[reinterpret_cast<CUgraphNode>(node.get())] = true;
            sorted.push_back(std::move(node));
            node = nullptr;
            progress = true;
        }
    }
    return sorted;
}

void lay_out(const std::vector<std::shared_ptr<GraphNode>>& sorted, GraphExec& exec) {
    std::unordered_map<CUgraphNode, std::size_t> places;
    std::vector<std::size_t> lane_ends;
    std::vector<bool> followed(sorted.size());
    for (const auto& source : sorted) {
        const auto handle = reinterpret_cast<CUgraphNode>(source.get());
        ExecNode node{handle, std::make_shared<GraphNode>(*source), lane_ends.size(), {}};
        for (CUgraphNode dependency : source->dependencies) {
            const std::size_t place = places.at(dependency);
            followed[place] = true;
            const std::size_t lane = exec.nodes[place].lane;
            const bool is_free = node.lane == lane_ends.size() && lane_ends[lane] == place;
            if (is_free) {
                node.lane = lane;
            } else {
                node.dependencies.push_back(place);
            }
        }
        if (node.lane == lane_ends.size()) lane_ends.push_back(0);
        lane_ends[node.lane] = exec.nodes.size();
        places[handle] = exec.nodes.size();
        exec.nodes.push_back(std::move(node));
    }
    exec.num_lanes = lane_ends.size();
    for (std::size_t i = 0; i < followed.size(); ++i) {
        if (!followed[i]) exec.leaves.push_back(i);
    }
}

CUresult instantiate(CUgraphExec* handle, CUgraph graph_handle, cuuint64_t flags) {
    Context* context = nullptr;
    if (CUresult error = current_context(context)) return error;
    const auto graph = driver().graphs.find(graph_handle);
    if (handle == nullptr || !graph || (flags & ~kKnownFlags) != 0) return CUDA_ERROR_INVALID_VALUE;
    const auto sorted = in_order(*graph);
    if (sorted.size() != graph->nodes.size()) return CUDA_ERROR_INVALID_VALUE;
    auto exec = std::make_shared<GraphExec>();
    exec->context = context;
    exec->flags = flags;
    lay_out(sorted, *exec);
    *handle = driver().graph_execs.add(std::move(exec));
    return CUDA_SUCCESS;
}

}  // namespace

CUresult launch_graph(GraphExec& exec, Stream& stream) {
    std::lock_guard lock(exec.mutex);
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
        Work work = node.node->work;
        auto* const kernel = std::get_if<KernelWork>(&work);
        if (kernel != nullptr && !own_priorities) kernel->priority = stream_priority;
        std::vector<Fence> fences;
        if (node.lane != 0) fences.push_back(begin);
        for (const std::size_t place : node.dependencies) fences.push_back(ends[place]);
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
    *flags = exec->flags & ~cuuint64_t{CUDA_GRAPH_INSTANTIATE_FLAG_UPLOAD};
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
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream_for_work(stream_handle, stream)) return error;
    std::shared_ptr<GraphExec> exec;
    if (CUresult error = find_exec(handle, exec)) return error;
    if (CUresult error = refuse_if_capturing(*stream)) return error;  // no child graphs
    return launch_graph(*exec, *stream);
}

SIMGPU_API CUresult cuGraphExecKernelNodeSetParams_v2(CUgraphExec handle, CUgraphNode source,
                                                      const CUDA_KERNEL_NODE_PARAMS_v2* params) {
    std::shared_ptr<GraphExec> exec;
    if (CUresult error = find_exec(handle, exec)) return error;
    std::lock_guard lock(exec->mutex);
    const auto found =
        std::find_if(exec->nodes.begin(), exec->nodes.end(),
                     [source](const ExecNode& node) { return node.source == source; });
    if (params == nullptr || found == exec->nodes.end()) return CUDA_ERROR_INVALID_VALUE;
    GraphNode& node = *found->node;
    const auto* const kernel = std::get_if<KernelWork>(&node.work);
    if (kernel == nullptr) return CUDA_ERROR_INVALID_VALUE;
    return prepare_kernel_node(*params, kernel->priority, node.work, node.kernel);
}
