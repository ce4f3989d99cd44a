// SPDX-License-Identifier: Apache-2.0
//
// Graphs of the simulated driver: children, clones, updates, memory and conditions.
#include "tests/unit/test_simgpu_support.h"

namespace {

CUgraph make_graph() {
    CUgraph graph = nullptr;
    REQUIRE(cuGraphCreate(&graph, 0) == CUDA_SUCCESS);
    return graph;
}

/// A node of one block of so many nanoseconds.
CUgraphNode add_kernel(const SimGpu& gpu, CUgraph graph, unsigned ns,
                       std::vector<CUgraphNode> after = {}) {
    void* params[] = {&ns};
    CUDA_KERNEL_NODE_PARAMS node_params{};
    node_params.func = gpu.function("unit");
    node_params.gridDimX = node_params.gridDimY = node_params.gridDimZ = 1;
    node_params.blockDimX = node_params.blockDimY = node_params.blockDimZ = 1;
    node_params.kernelParams = params;
    CUgraphNode node = nullptr;
    REQUIRE(cuGraphAddKernelNode(&node, graph, after.data(), after.size(), &node_params) ==
            CUDA_SUCCESS);
    return node;
}

CUgraphExec instantiate(CUgraph graph, unsigned long long flags = 0) {
    CUgraphExec exec = nullptr;
    REQUIRE(cuGraphInstantiateWithFlags(&exec, graph, flags) == CUDA_SUCCESS);
    return exec;
}

/// Launches, waits, and returns how long each kernel took, in order of completion.
std::vector<std::int64_t> durations(CUgraphExec exec) {
    simgpu_kernel_log_clear();
    REQUIRE(cuGraphLaunch(exec, nullptr) == CUDA_SUCCESS);
    REQUIRE(cuCtxSynchronize() == CUDA_SUCCESS);
    std::vector<std::int64_t> found;
    for (const auto& kernel : kernel_log()) found.push_back(kernel.end_ns - kernel.start_ns);
    return found;
}

using Durations = std::vector<std::int64_t>;

CUgraph conditional(const SimGpu& gpu, CUgraphConditionalNodeType type, unsigned value,
                    unsigned flags, CUgraph* body) {
    const CUgraph graph = make_graph();
    CUgraphConditionalHandle condition = 0;
    REQUIRE(cuGraphConditionalHandleCreate(&condition, graph, gpu.context, value, flags) ==
            CUDA_SUCCESS);
    CUgraphNodeParams params{};
    params.type = CU_GRAPH_NODE_TYPE_CONDITIONAL;
    params.conditional.handle = condition;
    params.conditional.type = type;
    params.conditional.size = 1;
    params.conditional.ctx = gpu.context;
    CUgraphNode node = nullptr;
    REQUIRE(cuGraphAddNode_v2(&node, graph, nullptr, nullptr, 0, &params) == CUDA_SUCCESS);
    *body = params.conditional.phGraph_out[0];
    add_kernel(gpu, graph, 3000, {node});
    return graph;
}

}  // namespace

TEST_CASE("Child graph runs in its node's place when its parent is launched", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUgraph child = make_graph();
    add_kernel(gpu, child, 200000);
    add_kernel(gpu, child, 300000);
    const CUgraph parent = make_graph();
    const CUgraphNode before = add_kernel(gpu, parent, 4000);
    CUgraphNode node = nullptr;
    CUgraph inner = nullptr;
    REQUIRE(cuGraphAddChildGraphNode(&node, parent, &before, 1, child) == CUDA_SUCCESS);
    add_kernel(gpu, parent, 5000, {node});
    CHECK(cuGraphAddChildGraphNode(&node, parent, nullptr, 0, parent) == CUDA_ERROR_INVALID_VALUE);
    add_kernel(gpu, child, 1000);  // too late: the child is a copy
    const CUgraphExec exec = instantiate(parent);
    CHECK(durations(exec) == Durations{4000, 200000, 300000, 5000});
    const auto log = kernel_log();
    CHECK(log[1].start_ns < log[2].end_ns);
    CHECK(log[2].start_ns < log[1].end_ns);
    REQUIRE(cuGraphChildGraphNodeGetGraph(node, &inner) == CUDA_SUCCESS);
    REQUIRE(cuGraphDestroy(parent) == CUDA_SUCCESS);
    std::size_t count = 0;
    CHECK(cuGraphGetNodes(inner, nullptr, &count) == CUDA_ERROR_INVALID_VALUE);
    CHECK(durations(exec).size() == 4);
}

TEST_CASE("Graph launch ends the capture when its stream is captured", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    const CUgraph graph = make_graph();
    add_kernel(gpu, graph, 2000);
    const CUgraphExec exec = instantiate(graph);
    REQUIRE(cuStreamBeginCapture(stream, CU_STREAM_CAPTURE_MODE_GLOBAL) == CUDA_SUCCESS);
    REQUIRE(gpu.launch(stream, 1000) == CUDA_SUCCESS);
    CHECK(cuGraphLaunch(exec, stream) == CUDA_ERROR_STREAM_CAPTURE_UNSUPPORTED);
    CUgraph captured = nullptr;
    CHECK(cuStreamEndCapture(stream, &captured) == CUDA_ERROR_STREAM_CAPTURE_INVALIDATED);
    CHECK(kernel_log().empty());
    CHECK(durations(exec) == Durations{2000});
}

TEST_CASE("Clone is a graph of its own when the original changes", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUgraph graph = make_graph();
    const CUgraphNode first = add_kernel(gpu, graph, 1000);
    const CUgraphNode second = add_kernel(gpu, graph, 2000, {first});
    CUgraph clone = nullptr;
    CUgraphNode found = nullptr;
    REQUIRE(cuGraphClone(&clone, graph) == CUDA_SUCCESS);
    REQUIRE(cuGraphNodeFindInClone(&found, second, clone) == CUDA_SUCCESS);
    CHECK(found != second);
    CHECK(cuGraphNodeFindInClone(&found, found, clone) == CUDA_ERROR_INVALID_VALUE);
    REQUIRE(cuGraphDestroyNode(second) == CUDA_SUCCESS);
    CHECK(durations(instantiate(graph)) == Durations{1000});
    REQUIRE(cuGraphDestroy(graph) == CUDA_SUCCESS);
    CHECK(durations(instantiate(clone)) == Durations{1000, 2000});
}

TEST_CASE("Executable graph does as another graph when it is updated with it", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUgraph graph = make_graph();
    const CUgraphNode node = add_kernel(gpu, graph, 1000);
    add_kernel(gpu, graph, 2000, {node});
    const CUgraphExec exec = instantiate(graph);
    const CUgraph other = make_graph();
    add_kernel(gpu, other, 4000, {add_kernel(gpu, other, 3000)});
    CUgraphExecUpdateResultInfo info{};
    REQUIRE(cuGraphExecUpdate(exec, other, &info) == CUDA_SUCCESS);
    CHECK(info.result == CU_GRAPH_EXEC_UPDATE_SUCCESS);
    CHECK(durations(exec) == Durations{3000, 4000});

    REQUIRE(cuGraphNodeSetEnabled(exec, node, 0) == CUDA_SUCCESS);
    unsigned is_enabled = 1;
    REQUIRE(cuGraphNodeGetEnabled(exec, node, &is_enabled) == CUDA_SUCCESS);
    CHECK(is_enabled == 0);
    CHECK(durations(exec) == Durations{4000});
    REQUIRE(cuGraphNodeSetEnabled(exec, node, 1) == CUDA_SUCCESS);

    const CUgraph apart = make_graph();
    add_kernel(gpu, apart, 5000);
    add_kernel(gpu, apart, 6000);
    CHECK(cuGraphExecUpdate(exec, apart, &info) == CUDA_ERROR_GRAPH_EXEC_UPDATE_FAILURE);
    CHECK(info.result == CU_GRAPH_EXEC_UPDATE_ERROR_TOPOLOGY_CHANGED);
    CUgraphNode empty = nullptr;
    const CUgraph typed = make_graph();
    REQUIRE(cuGraphAddEmptyNode(&empty, typed, nullptr, 0) == CUDA_SUCCESS);
    add_kernel(gpu, typed, 1000, {empty});
    CHECK(cuGraphExecUpdate(exec, typed, &info) == CUDA_ERROR_GRAPH_EXEC_UPDATE_FAILURE);
    CHECK(info.result == CU_GRAPH_EXEC_UPDATE_ERROR_NODE_TYPE_CHANGED);
    CHECK(info.errorNode == empty);
    CHECK(durations(exec) == Durations{3000, 4000});  // as before
}

TEST_CASE("Graph's memory is the program's until it is freed", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUgraph graph = make_graph();
    CUDA_MEM_ALLOC_NODE_PARAMS params{};
    params.poolProps.allocType = CU_MEM_ALLOCATION_TYPE_PINNED;
    params.poolProps.location.type = CU_MEM_LOCATION_TYPE_DEVICE;
    params.bytesize = 4096;
    CUgraphNode allocation = nullptr;
    REQUIRE(cuGraphAddMemAllocNode(&allocation, graph, nullptr, 0, &params) == CUDA_SUCCESS);
    REQUIRE(params.dptr != 0);
    CUgraph clone = nullptr;
    CHECK(cuGraphClone(&clone, graph) == CUDA_ERROR_NOT_SUPPORTED);
    CHECK(cuMemFree(params.dptr) == CUDA_ERROR_INVALID_VALUE);  // not allocated yet
    const CUgraphExec exec = instantiate(graph);
    REQUIRE(cuGraphLaunch(exec, nullptr) == CUDA_SUCCESS);
    CHECK(cuGraphLaunch(exec, nullptr) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemFree(params.dptr) == CUDA_SUCCESS);
    CHECK(cuMemFree(params.dptr) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuGraphLaunch(exec, nullptr) == CUDA_SUCCESS);
    CHECK(cuMemFreeAsync(params.dptr, nullptr) == CUDA_SUCCESS);
    const CUgraphExec frees_itself =
        instantiate(graph, CUDA_GRAPH_INSTANTIATE_FLAG_AUTO_FREE_ON_LAUNCH);
    for (int i = 0; i < 3; ++i) CHECK(cuGraphLaunch(frees_itself, nullptr) == CUDA_SUCCESS);
    CHECK(cuMemFree(params.dptr) == CUDA_SUCCESS);
    CUgraphNode free = nullptr;
    CHECK(cuGraphAddMemFreeNode(&free, graph, &allocation, 1, 4096) == CUDA_ERROR_INVALID_VALUE);
    REQUIRE(cuGraphAddMemFreeNode(&free, graph, &allocation, 1, params.dptr) == CUDA_SUCCESS);
    const CUgraphExec complete = instantiate(graph);
    for (int i = 0; i < 3; ++i) CHECK(cuGraphLaunch(complete, nullptr) == CUDA_SUCCESS);
    CHECK(cuMemFree(params.dptr) == CUDA_ERROR_INVALID_VALUE);
    // The last to know of it gives it back.
    for (CUgraphExec each : {exec, frees_itself, complete}) cuGraphExecDestroy(each);
    REQUIRE(cuGraphDestroy(graph) == CUDA_SUCCESS);
    CHECK(cuMemsetD8(params.dptr, 0, 1) == CUDA_ERROR_INVALID_VALUE);
}

TEST_CASE("Conditional's body runs when its default value says so", "[unit][simgpu]") {
    const SimGpu gpu;
    const unsigned value = GENERATE(0, 1);
    CUgraph body = nullptr;
    const CUgraph graph =
        conditional(gpu, CU_GRAPH_COND_TYPE_IF, value, CU_GRAPH_COND_ASSIGN_DEFAULT, &body);
    const CUstream stream = gpu.stream();
    CUgraph ended = nullptr;
    REQUIRE(cuStreamBeginCaptureToGraph(stream, body, nullptr, nullptr, 0,
                                        CU_STREAM_CAPTURE_MODE_GLOBAL) == CUDA_SUCCESS);
    REQUIRE(gpu.launch(stream, 1000) == CUDA_SUCCESS);
    REQUIRE(gpu.launch(stream, 2000) == CUDA_SUCCESS);
    REQUIRE(cuStreamEndCapture(stream, &ended) == CUDA_SUCCESS);
    CHECK(ended == body);
    CHECK(durations(instantiate(graph)) ==
          (value == 1 ? Durations{1000, 2000, 3000} : Durations{3000}));
}

TEST_CASE("Conditional is refused when only a kernel could end it", "[unit][simgpu]") {
    const SimGpu gpu;
    CUgraph body = nullptr;
    CUgraphExec exec = nullptr;
    const unsigned flags = GENERATE(0U, unsigned{CU_GRAPH_COND_ASSIGN_DEFAULT});
    const CUgraph loop = conditional(gpu, CU_GRAPH_COND_TYPE_WHILE, 1, flags, &body);
    CHECK(cuGraphInstantiateWithFlags(&exec, loop, 0) == CUDA_ERROR_NOT_SUPPORTED);
    const CUgraph never =
        conditional(gpu, CU_GRAPH_COND_TYPE_WHILE, 0, CU_GRAPH_COND_ASSIGN_DEFAULT, &body);
    CHECK(durations(instantiate(never)) == Durations{3000});
}

TEST_CASE("Graph for the device is accepted when it has only what kernels may launch",
          "[unit][simgpu]") {
    const SimGpu gpu;
    const CUgraph graph = make_graph();
    add_kernel(gpu, graph, 1000);
    CHECK(durations(instantiate(graph, CUDA_GRAPH_INSTANTIATE_FLAG_DEVICE_LAUNCH)).size() == 1);
    CUDA_HOST_NODE_PARAMS host{};
    host.fn = [](void*) {};
    CUgraphNode node = nullptr;
    CUgraphExec exec = nullptr;
    REQUIRE(cuGraphAddHostNode(&node, graph, nullptr, 0, &host) == CUDA_SUCCESS);
    CHECK(cuGraphInstantiateWithFlags(&exec, graph, CUDA_GRAPH_INSTANTIATE_FLAG_DEVICE_LAUNCH) ==
          CUDA_ERROR_NOT_SUPPORTED);
}
