// SPDX-License-Identifier: Apache-2.0
//
// From a graph to an executable one.
//
// 1 Flattening. Child graphs, and those bodies of conditionals that will run, take their node's
//   place, between an empty node that begins and one that ends them. Which bodies run is known
//   beforehand: no simulated kernel sets a condition, so it keeps the value that it has at launch.
// 2 Lanes. A node goes on the lane of a dependency that it is the first to follow, else on a new
//   one.
#include <fmt/format.h>

#include <algorithm>
#include <unordered_map>

#include "tools/simgpu/graph/graph.h"

namespace urgengo::simgpu {
namespace {

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

class Flattening {
  public:
    explicit Flattening(std::vector<ExecNode>& nodes) : nodes_(nodes) {}

    /// Appends the graph's nodes, those without dependencies after the place `entry`.
    CUresult append(const Graph& graph, std::optional<std::size_t> entry) {
        const auto sorted = in_order(graph);
        if (sorted.size() != graph.nodes.size()) return CUDA_ERROR_INVALID_VALUE;  // a cycle
        std::unordered_map<CUgraphNode, std::size_t> ends;
        for (const auto& source : sorted) {
            std::vector<std::size_t> dependencies;
            for (CUgraphNode dependency : source->dependencies)
                dependencies.push_back(ends.at(dependency));
            if (dependencies.empty() && entry) dependencies.push_back(*entry);
            const auto handle = reinterpret_cast<CUgraphNode>(source.get());
            std::size_t end = append_node(handle, source, std::move(dependencies));
            std::vector<const Graph*> bodies;
            if (CUresult error = bodies_that_run(*source, bodies)) return error;
            for (const Graph* body : bodies) {
                const std::size_t begin = end;
                if (CUresult error = append(*body, begin)) return error;
                end = append_node(nullptr, std::make_shared<GraphNode>(), leaves_since(begin));
            }
            ends[handle] = end;
        }
        return CUDA_SUCCESS;
    }

    /// @returns the places from `first` on that nothing depends on
    std::vector<std::size_t> leaves_since(std::size_t first) const {
        std::vector<bool> followed(nodes_.size());
        for (const ExecNode& node : nodes_)
            for (const std::size_t place : node.dependencies) followed[place] = true;
        std::vector<std::size_t> leaves;
        for (std::size_t i = first; i < nodes_.size(); ++i)
            if (!followed[i]) leaves.push_back(i);
        return leaves;
    }

  private:
    std::size_t append_node(CUgraphNode source, const std::shared_ptr<GraphNode>& node,
                            std::vector<std::size_t> dependencies) {
        nodes_.push_back(
            {source, std::make_shared<GraphNode>(*node), 0, std::move(dependencies), {}});
        return nodes_.size() - 1;
    }

    static CUresult bodies_that_run(const GraphNode& node, std::vector<const Graph*>& bodies) {
        if (node.type != CU_GRAPH_NODE_TYPE_CONDITIONAL) {
            for (const auto& child : node.children) bodies.push_back(child.get());
            return CUDA_SUCCESS;
        }
        const auto value = launch_value(node.condition);
        if (!value) {
            complain(
                "conditional node: found a condition without CU_GRAPH_COND_ASSIGN_DEFAULT, "
                "which a kernel would have to set, accepted: one with it");
            return CUDA_ERROR_NOT_SUPPORTED;
        }
        std::size_t body = *value;  // a switch
        if (node.condition_type == CU_GRAPH_COND_TYPE_IF) body = *value != 0 ? 0 : 1;
        if (node.condition_type == CU_GRAPH_COND_TYPE_WHILE) {
            if (*value != 0) {
                complain(fmt::format(
                    "conditional node: found a loop while the condition is not 0, which begins as "
                    "{} and which no simulated kernel ends, accepted: one that begins as 0",
                    *value));
                return CUDA_ERROR_NOT_SUPPORTED;
            }
            body = node.children.size();
        }
        if (body < node.children.size()) bodies.push_back(node.children[body].get());
        return CUDA_SUCCESS;
    }

    std::vector<ExecNode>& nodes_;
};

}  // namespace

CUresult lay_out(const Graph& graph, GraphExec& exec) {
    Flattening flattening(exec.nodes);
    if (CUresult error = flattening.append(graph, std::nullopt)) return error;
    exec.leaves = flattening.leaves_since(0);
    std::vector<std::size_t> lane_ends;
    for (std::size_t place = 0; place < exec.nodes.size(); ++place) {
        ExecNode& node = exec.nodes[place];
        node.lane = lane_ends.size();
        for (const std::size_t dependency : node.dependencies) {
            const std::size_t lane = exec.nodes[dependency].lane;
            const bool is_free = node.lane == lane_ends.size() && lane_ends[lane] == dependency;
            if (is_free) {
                node.lane = lane;
            } else {
                node.other_dependencies.push_back(dependency);
            }
        }
        if (node.lane == lane_ends.size()) lane_ends.push_back(0);
        lane_ends[node.lane] = place;
    }
    exec.num_lanes = lane_ends.size();
    return CUDA_SUCCESS;
}

}  // namespace urgengo::simgpu
