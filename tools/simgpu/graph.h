// SPDX-License-Identifier: Apache-2.0
//
// Graphs: nodes with the work that they stand for, and executable copies of them. As with the
// driver, one graph is used by one thread at a time; a graph that is being captured is guarded by
// the capture's lock.
#pragma once

#include <memory>
#include <vector>

#include "tools/simgpu/driver_state.h"

namespace urgengo::simgpu {

/// What a kernel node was made from, for those who ask.
struct KernelCall {
    CUDA_KERNEL_NODE_PARAMS_v2
        params{};  ///< kernelParams: `pointers`, or null if sizes are unknown
    bool cooperative = false;
    std::vector<std::vector<std::byte>> values;
    std::vector<void*> pointers;
};

struct GraphNode {
    CUgraph graph = nullptr;
    CUgraphNodeType type = CU_GRAPH_NODE_TYPE_EMPTY;
    Work work;  ///< a kernel's priority is the node's own
    std::vector<CUgraphNode> dependencies;
    std::shared_ptr<KernelCall> kernel;
};

struct Graph {
    std::vector<std::shared_ptr<GraphNode>> nodes;  ///< in the order of their creation
};

/// A node of an executable graph. Those before it on its lane come first without being asked.
struct ExecNode {
    CUgraphNode source;
    std::shared_ptr<GraphNode> node;
    std::size_t lane;
    std::vector<std::size_t> dependencies;  ///< on other lanes, by place
};

struct GraphExec {
    Context* context = nullptr;
    cuuint64_t flags = 0;
    std::mutex mutex;
    std::vector<ExecNode> nodes;      ///< dependencies first
    std::vector<std::size_t> leaves;  ///< those that nothing depends on
    std::size_t num_lanes = 0;
    Fence last_end;  ///< an executable graph never runs beside itself
};

/// Makes a node and adds it to the graph.
CUgraphNode add_node(Graph& graph, CUgraph graph_handle, CUgraphNodeType type, Work work,
                     std::vector<CUgraphNode> dependencies,
                     std::shared_ptr<KernelCall> kernel = nullptr);

CUgraph make_graph();
void destroy_graph(CUgraph handle);

/// @returns what a node of this work is called
CUgraphNodeType type_of(const Work& work);

/// Fills a kernel node's work and description.
CUresult prepare_kernel_node(const CUDA_KERNEL_NODE_PARAMS_v2& params, int priority, Work& work,
                             std::shared_ptr<KernelCall>& call);

/// @returns the launch as a node keeps it
std::shared_ptr<KernelCall> describe_launch(const CUlaunchConfig& config, CUfunction function,
                                            void** params, void** extra, bool cooperative);

/// Queues the graph's work on the stream.
CUresult launch_graph(GraphExec& exec, Stream& stream);

}  // namespace urgengo::simgpu
