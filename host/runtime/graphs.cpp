// SPDX-License-Identifier: Apache-2.0
//
// What an executable graph is to the scheduler (graph_units.h). Looked at once, when the program
// instantiates it: by its first launch the graph that it was made of may be gone. Nothing of it is
// changed.
//
// Who will launch it is not known then, and looking costs a few questions a node. So it is done
// only where the name can matter: while a profile is learned, and when the profile in use knows
// some graph. A profile that knows none finds a graph of any name unknown.
#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <thread>
#include <vector>

#include "host/base/hash.h"
#include "host/identity/kernel_name.h"
#include "host/runtime/runtime.h"

namespace urgengo::runtime {
namespace {

constexpr int kMaxDepth = 8;  // of graphs in graphs
constexpr int kMaxYields = 10'000;

}  // namespace

struct Runtime::GraphContents {
    std::vector<std::string> nodes;
    std::size_t num_kernels = 0;
    double utilization = 0;  ///< summed over them; while tracing only
    const exec::MarkContext* context = nullptr;
    bool may_read_names = false;
};

void Runtime::describe_nodes(CUgraph graph, GraphContents& contents, int depth) {
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
                               ? identity::kernel_name(driver_, launch.function)
                               : nullptr;
        contents.nodes.push_back(fmt::format("{} {}", name ? name : "?", launch.block_threads));
        ++contents.num_kernels;
        if (contents.context)
            contents.utilization += tracer_.occupied_share(launch, *contents.context);
    }
}

void Runtime::graph_instantiated(CUgraphExec executable, CUgraph graph) {
    if (mode() == config::Mode::kOff || !driver_.cuGraphGetNodes || !driver_.cuGraphNodeGetType)
        return;
    if (!tracer_.is_on() && !profile_knows_graphs_) return;
    const exec::RelaxedCaptureMode relaxed(driver_);
    GraphContents contents;
    // How much of the GPU it takes is learned while profiling; a graph that the profile does not
    // know counts as taking all of it.
    if (tracer_.is_on()) contents.context = marks_.prepare();
    // Its name is for good: somebody who unloads is waited for, for a while.
    for (int i = 0; i < kMaxYields && name_gate_.is_closed(); ++i) std::this_thread::yield();
    {
        const identity::NameGate::Reading reading(name_gate_);
        contents.may_read_names = static_cast<bool>(reading);
        describe_nodes(graph, contents, 0);
    }
    std::sort(contents.nodes.begin(), contents.nodes.end());
    std::string all;
    for (const std::string& text : contents.nodes) all += text + '\n';
    const std::size_t kernels = contents.num_kernels;
    identity::GraphUnit unit;
    unit.name = fmt::format("(graph of {} kernel{}, {:08x})", kernels, kernels == 1 ? "" : "s",
                            static_cast<std::uint32_t>(fnv1a64(all)));
    unit.name_hash = fnv1a64(unit.name);
    if (contents.context && kernels > 0)
        unit.utilization = contents.utilization / static_cast<double>(kernels);
    // If the handle was another's. (Kernels' handles are what they were.)
    if (graph_units_.add(executable, std::move(unit))) names_epoch_.fetch_add(1);
}

void Runtime::graph_destroyed(CUgraphExec executable) {
    graph_units_.remove(executable);
}

void Runtime::look_up_graph(ThreadState& thread, ThreadState::CachedKernel& cached,
                            CUgraphExec graph) {
    static constexpr std::uint64_t kUnknown = fnv1a64(config::kGraphName);
    const auto unit = graph_units_.find(graph);
    cached.name_hash = unit ? unit->name_hash : kUnknown;
    cached.utilization = unit ? static_cast<float>(unit->utilization) : 1;
    if (tracer_.is_on())
        tracer_.name(thread, cached.name_hash, unit ? unit->name : config::kGraphName);
}

}  // namespace urgengo::runtime
