// SPDX-License-Identifier: Apache-2.0
#include "host/identity/graphs.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "host/base/hash.h"
#include "host/identity/kernel_name.h"
#include "host/identity/occupied_share.h"
#include "host/model/graph_name.h"

namespace urgengo::identity {
namespace {

constexpr int kMaxDepth = 8;  // of graphs in graphs
constexpr int kMaxYields = 10'000;

}  // namespace

struct Graphs::Contents {
    std::vector<std::string> nodes;
    std::size_t num_kernels = 0;
    double utilization = 0;  ///< summed over them, with a context
    const exec::MarkContext* context = nullptr;
    bool may_read_names = false;
};

void Graphs::describe_nodes(CUgraph graph, Contents& contents, int depth) const {
    std::size_t count = 0;
    if (driver_.cuGraphGetNodes(graph, nullptr, &count) != CUDA_SUCCESS || count == 0) return;
    std::vector<CUgraphNode> nodes(count);
    if (driver_.cuGraphGetNodes(graph, nodes.data(), &count) != CUDA_SUCCESS) return;
    nodes.resize(std::min(count, nodes.size()));
    for (const CUgraphNode node : nodes) {
        CUgraphNodeType type{};
        if (driver_.cuGraphNodeGetType(node, &type) != CUDA_SUCCESS) continue;
        CUgraph child = nullptr;
        if (type == CU_GRAPH_NODE_TYPE_GRAPH && depth < kMaxDepth &&
            driver_.cuGraphChildGraphNodeGetGraph &&
            driver_.cuGraphChildGraphNodeGetGraph(node, &child) == CUDA_SUCCESS) {
            describe_nodes(child, contents, depth + 1);
            continue;
        }
        CUDA_KERNEL_NODE_PARAMS parameters{};
        if (type != CU_GRAPH_NODE_TYPE_KERNEL || !driver_.cuGraphKernelNodeGetParams_v2 ||
            driver_.cuGraphKernelNodeGetParams_v2(node, &parameters) != CUDA_SUCCESS) {
            contents.nodes.push_back(fmt::format("type {}", static_cast<int>(type)));
            continue;
        }
        Launch launch;
        launch.function =
            parameters.func ? parameters.func : reinterpret_cast<CUfunction>(parameters.kern);
        launch.grid_blocks =
            std::uint64_t{parameters.gridDimX} * parameters.gridDimY * parameters.gridDimZ;
        launch.block_threads = parameters.blockDimX * parameters.blockDimY * parameters.blockDimZ;
        launch.shared_bytes = parameters.sharedMemBytes;
        const char* name = launch.function && contents.may_read_names
                               ? kernel_name(driver_, launch.function)
                               : nullptr;
        contents.nodes.push_back(fmt::format("{} {}", name ? name : "?", launch.block_threads));
        ++contents.num_kernels;
        if (contents.context)
            contents.utilization += occupied_share(driver_, launch, *contents.context);
    }
}

bool Graphs::add(CUgraphExec executable, CUgraph graph, const exec::MarkContext* context) {
    Contents contents;
    contents.context = context;
    // Its name is for good: an unloading thread is waited for, for a while.
    for (int i = 0; i < kMaxYields && gate_.is_closed(); ++i) std::this_thread::yield();
    {
        const NameGate::Reading reading(gate_);
        contents.may_read_names = static_cast<bool>(reading);
        describe_nodes(graph, contents, 0);
    }
    std::sort(contents.nodes.begin(), contents.nodes.end());
    std::string all;
    for (const std::string& text : contents.nodes) all += text + '\n';
    const std::size_t kernels = contents.num_kernels;
    GraphUnit unit;
    unit.name = model::graph_name(kernels, static_cast<std::uint32_t>(fnv1a64(all)));
    unit.name_hash = fnv1a64(unit.name);
    if (context && kernels > 0)
        unit.utilization = contents.utilization / static_cast<double>(kernels);
    const std::lock_guard lock(mutex_);
    return !units_.insert_or_assign(executable, std::move(unit)).second;
}

void Graphs::remove(CUgraphExec executable) {
    const std::lock_guard lock(mutex_);
    if (const auto unit = units_.find(executable); unit != units_.end()) unit->second = {};
}

std::optional<GraphUnit> Graphs::find(CUgraphExec executable) const {
    const std::lock_guard lock(mutex_);
    const auto unit = units_.find(executable);
    return unit == units_.end() || unit->second.name.empty() ? std::nullopt
                                                             : std::optional(unit->second);
}

}  // namespace urgengo::identity
