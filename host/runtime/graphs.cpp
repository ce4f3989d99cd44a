// SPDX-License-Identifier: Apache-2.0
//
// What an executable graph is to the scheduler (graph_units.h). Looked at once, when the program
// instantiates it; nothing of it is changed.
#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "host/base/hash.h"
#include "host/runtime/runtime.h"

namespace urgengo::runtime {
namespace {

constexpr int kMaxDepth = 8;  // of graphs in graphs

}  // namespace

void Runtime::describe_nodes(CUgraph graph, std::vector<std::string>& texts, double& utilization,
                             std::size_t& kernels, int depth) const {
    std::size_t count = 0;
    if (driver_.cuGraphGetNodes(graph, nullptr, &count) != CUDA_SUCCESS) return;
    std::vector<CUgraphNode> nodes(count);
    if (count == 0 || driver_.cuGraphGetNodes(graph, nodes.data(), &count) != CUDA_SUCCESS) return;
    nodes.resize(std::min(count, nodes.size()));
    const exec::MarkContext* context = nullptr;
    for (const CUgraphNode node : nodes) {
        CUgraphNodeType type{};
        if (driver_.cuGraphNodeGetType(node, &type) != CUDA_SUCCESS) continue;
        CUgraph child = nullptr;
        if (type == CU_GRAPH_NODE_TYPE_GRAPH && depth < kMaxDepth &&
            driver_.cuGraphChildGraphNodeGetGraph &&
            driver_.cuGraphChildGraphNodeGetGraph(node, &child) == CUDA_SUCCESS) {
            describe_nodes(child, texts, utilization, kernels, depth + 1);
            continue;
        }
        CUDA_KERNEL_NODE_PARAMS parameters{};
        if (type != CU_GRAPH_NODE_TYPE_KERNEL || !driver_.cuGraphKernelNodeGetParams_v2 ||
            driver_.cuGraphKernelNodeGetParams_v2(node, &parameters) != CUDA_SUCCESS) {
            texts.push_back(fmt::format("type {}", static_cast<int>(type)));
            continue;
        }
        Launch launch;
        launch.function =
            parameters.func ? parameters.func : reinterpret_cast<CUfunction>(parameters.kern);
        launch.grid_blocks =
            std::uint64_t{parameters.gridDimX} * parameters.gridDimY * parameters.gridDimZ;
        launch.block_threads = parameters.blockDimX * parameters.blockDimY * parameters.blockDimZ;
        launch.shared_bytes = parameters.sharedMemBytes;
        const char* name = launch.function ? kernel_name(launch.function) : nullptr;
        texts.push_back(fmt::format("{} {}", name ? name : "?", launch.block_threads));
        if (!context) context = const_cast<exec::ProgressMarks&>(marks_).prepare();
        utilization += context ? occupied_share(launch, *context) : 1;
        ++kernels;
    }
}

void Runtime::graph_instantiated(CUgraphExec executable, CUgraph graph) {
    if (!driver_.cuGraphGetNodes || !driver_.cuGraphNodeGetType) return;
    const exec::RelaxedCaptureMode relaxed(driver_);
    std::vector<std::string> texts;
    double utilization = 0;
    std::size_t kernels = 0;
    describe_nodes(graph, texts, utilization, kernels, 0);
    std::sort(texts.begin(), texts.end());
    std::string all;
    for (const std::string& text : texts) all += text + '\n';
    GraphUnit unit;
    unit.name = fmt::format("(graph of {} kernel{}, {:08x})", kernels, kernels == 1 ? "" : "s",
                            static_cast<std::uint32_t>(fnv1a64(all)));
    unit.name_hash = fnv1a64(unit.name);
    unit.utilization = kernels > 0 ? utilization / static_cast<double>(kernels) : 1;
    graph_units_.add(executable, std::move(unit));
    forget_names();  // the handle may have been another's
}

void Runtime::graph_destroyed(CUgraphExec executable) {
    if (graph_units_.remove(executable)) forget_names();
}

void Runtime::look_up_graph(ThreadState& thread, ThreadState::CachedKernel& cached,
                            CUgraphExec graph) {
    static constexpr std::uint64_t kUnknown = fnv1a64(config::kGraphName);
    const auto unit = graph_units_.find(graph);
    cached.name_hash = unit ? unit->name_hash : kUnknown;
    cached.utilization = unit ? static_cast<float>(unit->utilization) : 1;
    if (trace_.writer) trace_name(thread, cached.name_hash, unit ? unit->name : config::kGraphName);
}

}  // namespace urgengo::runtime
