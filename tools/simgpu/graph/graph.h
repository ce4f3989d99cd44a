// SPDX-License-Identifier: Apache-2.0
//
// Graphs: nodes with the work that they stand for, and executable copies of them. As with the
// driver, one graph is used by one thread at a time; a graph that is being captured is guarded by
// the capture's lock.
//
// A node that is a graph itself (child graphs, the bodies of conditionals) has it in `children`;
// instantiation puts their nodes in its place, between its begin and its end (graph_layout.cpp).
#pragma once

#include <memory>
#include <vector>

#include "tools/simgpu/api/driver_state.h"

namespace urgengo::simgpu {

/// What a kernel node was made from, for those who ask.
struct KernelCall {
    CUDA_KERNEL_NODE_PARAMS_v2
        params{};  ///< kernelParams: `pointers`, or null if sizes are unknown
    bool cooperative = false;
    std::vector<std::vector<std::byte>> values;
    std::vector<void*> pointers;
};

/// Memory that belongs to a graph. The range is the graph's for its whole life; the program may use
/// it from the allocation node on until it is freed, by a node or by a call.
struct GraphMemory {
    explicit GraphMemory(std::uintptr_t base_) : base(base_) {}
    ~GraphMemory() {
        // Its context may have taken it along, and another allocation have the address.
        const auto allocation = driver().memory.find(base);
        if (allocation && allocation->graph_uses == in_use) driver().memory.remove(base);
    }
    GraphMemory(const GraphMemory&) = delete;
    GraphMemory& operator=(const GraphMemory&) = delete;

    const std::uintptr_t base;
    std::shared_ptr<std::atomic<bool>> in_use = std::make_shared<std::atomic<bool>>(false);
};

struct GraphNode {
    CUgraph graph = nullptr;
    CUgraphNodeType type = CU_GRAPH_NODE_TYPE_EMPTY;
    Work work = TimedWork{};  ///< a kernel's priority is the node's own
    std::vector<CUgraphNode> dependencies;
    std::shared_ptr<KernelCall> kernel;
    CUgraphNode original = nullptr;  ///< in the graph that this one's was cloned from
    std::vector<std::shared_ptr<Graph>> children;
    std::vector<CUgraph> child_handles;
    std::uint64_t condition = 0;  ///< the handle of a conditional node
    CUgraphConditionalNodeType condition_type = CU_GRAPH_COND_TYPE_IF;
    std::shared_ptr<GraphMemory> memory;  ///< of an allocation node
    CUdeviceptr freed = 0;                ///< by a free node
};

struct Graph {
    std::vector<std::shared_ptr<GraphNode>> nodes;  ///< in the order of their creation
};

/// A node of an executable graph. Those before it on its lane come first without being asked.
struct ExecNode {
    CUgraphNode source;  ///< null for what instantiation added
    std::shared_ptr<GraphNode> node;
    std::size_t lane;
    std::vector<std::size_t> dependencies;        ///< by place
    std::vector<std::size_t> other_dependencies;  ///< those of them that are on other lanes
    bool is_enabled = true;
};

struct GraphExec {
    Context* context = nullptr;
    cuuint64_t flags = 0;
    std::shared_ptr<Graph> graph;  ///< a copy of what it was made from
    std::mutex mutex;
    std::vector<ExecNode> nodes;      ///< dependencies first
    std::vector<std::size_t> leaves;  ///< those that nothing depends on
    std::size_t num_lanes = 0;
    Fence last_end;  ///< an executable graph never runs beside itself
};

/// Adds a node to the graph.
CUgraphNode add_node(Graph& graph, CUgraph graph_handle, GraphNode node);

/// Checks the arguments that all ways to add a node have, and adds it.
CUresult add_node_checked(CUgraphNode* handle, CUgraph graph_handle,
                          const CUgraphNode* dependencies, std::size_t num_dependencies,
                          GraphNode node);

CUgraph make_graph();
void destroy_graph(CUgraph handle);

/// @returns a copy, children and all, without handles yet
std::shared_ptr<Graph> clone_graph(const Graph& graph);

/// Gives the graph, its nodes, and their children handles.
CUgraph register_graph(const std::shared_ptr<Graph>& graph);

/// @returns a node that runs a copy of the graph
GraphNode make_child_node(const Graph& graph);

/// @returns a node that allocates; nothing if the device has not that much
CUresult make_alloc_node(Context& context, std::size_t bytes, GraphNode& node);
/// @returns CUDA_ERROR_INVALID_VALUE if that is not the memory of a graph
CUresult make_free_node(CUdeviceptr pointer, GraphNode& node);

/// @returns the value that a condition has when the graph is launched; nothing if that is undefined
std::optional<unsigned> launch_value(std::uint64_t condition);

CUresult find_graph(CUgraph handle, std::shared_ptr<Graph>& graph);
CUresult find_node(CUgraphNode handle, std::shared_ptr<GraphNode>& node);

/// @returns what a node of this work is called
CUgraphNodeType type_of(const Work& work);

/// Fills a kernel node's work and description.
CUresult prepare_kernel_node(const CUDA_KERNEL_NODE_PARAMS_v2& params, int priority, Work& work,
                             std::shared_ptr<KernelCall>& call);
CUDA_KERNEL_NODE_PARAMS_v2 widen(const CUDA_KERNEL_NODE_PARAMS_v1& params);

/// @returns the launch as a node keeps it
std::shared_ptr<KernelCall> describe_launch(const CUlaunchConfig& config, CUfunction function,
                                            void** params, void** extra, bool cooperative);

/// Lays the graph's nodes out (graph_layout.cpp).
/// @returns why it cannot be instantiated, if so
CUresult lay_out(const Graph& graph, GraphExec& exec);

/// Queues the graph's work on the stream.
CUresult launch_graph(GraphExec& exec, Stream& stream);

}  // namespace urgengo::simgpu
