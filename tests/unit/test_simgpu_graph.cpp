// SPDX-License-Identifier: Apache-2.0
//
// Graphs of the simulated driver: built by hand, instantiated, launched.
#include <array>
#include <atomic>

#include "tests/unit/test_simgpu_support.h"

namespace {

/// A graph and what its nodes need.
struct Builder {
    explicit Builder(const SimGpu& gpu_) : gpu(gpu_) {
        REQUIRE(cuGraphCreate(&graph, 0) == CUDA_SUCCESS);
    }

    CUDA_KERNEL_NODE_PARAMS kernel_params(unsigned& ns, void** params, unsigned blocks = 1) const {
        params[0] = &ns;
        CUDA_KERNEL_NODE_PARAMS node{};
        node.func = gpu.function("unit");
        node.gridDimX = blocks;
        node.gridDimY = node.gridDimZ = node.blockDimY = node.blockDimZ = 1;
        node.blockDimX = 32;
        node.kernelParams = params;
        return node;
    }

    CUgraphNode kernel(unsigned ns, std::vector<CUgraphNode> after = {},
                       unsigned blocks = 1) const {
        void* params[1];
        const auto node_params = kernel_params(ns, params, blocks);
        CUgraphNode node = nullptr;
        REQUIRE(cuGraphAddKernelNode(&node, graph, after.data(), after.size(), &node_params) ==
                CUDA_SUCCESS);
        return node;
    }

    CUgraphExec instantiate(unsigned long long flags = 0) const {
        CUgraphExec exec = nullptr;
        REQUIRE(cuGraphInstantiate(&exec, graph, flags) == CUDA_SUCCESS);
        return exec;
    }

    const SimGpu& gpu;
    CUgraph graph = nullptr;
};

}  // namespace

TEST_CASE("Graph runs its nodes in order of their dependencies when it is launched",
          "[unit][simgpu]") {
    const SimGpu gpu;
    const Builder builder(gpu);
    const CUstream stream = gpu.stream();
    std::uint32_t* words = nullptr;
    REQUIRE(cuMemHostAlloc(reinterpret_cast<void**>(&words), 64, 0) == CUDA_SUCCESS);
    CUdeviceptr memory = 0;
    REQUIRE(cuMemAlloc(&memory, 64) == CUDA_SUCCESS);

    const CUgraphNode first = builder.kernel(100000);
    CUDA_MEMSET_NODE_PARAMS set{};
    set.dst = memory;
    set.value = 9;
    set.elementSize = 4;
    set.width = 2;
    set.height = 2;
    set.pitch = 16;
    CUgraphNode memset = nullptr;
    REQUIRE(cuGraphAddMemsetNode(&memset, builder.graph, &first, 1, &set, gpu.context) ==
            CUDA_SUCCESS);
    CUDA_MEMCPY3D copy{};
    copy.srcMemoryType = CU_MEMORYTYPE_DEVICE;
    copy.srcDevice = memory;
    copy.dstMemoryType = CU_MEMORYTYPE_HOST;
    copy.dstHost = words;
    copy.WidthInBytes = 64;
    copy.Height = copy.Depth = 1;
    CUgraphNode memcpy = nullptr;
    REQUIRE(cuGraphAddMemcpyNode(&memcpy, builder.graph, &memset, 1, &copy, gpu.context) ==
            CUDA_SUCCESS);
    CUgraphNode empty = nullptr;
    REQUIRE(cuGraphAddEmptyNode(&empty, builder.graph, &memcpy, 1) == CUDA_SUCCESS);
    static std::atomic<std::uint32_t> seen;
    seen = 0;
    CUDA_HOST_NODE_PARAMS host{};
    host.fn = [](void* data) { seen = *static_cast<std::uint32_t*>(data); };
    host.userData = words;
    CUgraphNode call = nullptr;
    REQUIRE(cuGraphAddHostNode(&call, builder.graph, &empty, 1, &host) == CUDA_SUCCESS);

    std::array<CUgraphNode, 8> nodes{};
    std::size_t count = nodes.size();
    REQUIRE(cuGraphGetNodes(builder.graph, nodes.data(), &count) == CUDA_SUCCESS);
    CHECK(count == 5);
    CHECK(nodes[4] == call);
    count = 1;
    REQUIRE(cuGraphGetRootNodes(builder.graph, nodes.data(), &count) == CUDA_SUCCESS);
    CHECK(nodes[0] == first);

    const CUgraphExec exec = builder.instantiate();
    REQUIRE(cuGraphUpload(exec, stream) == CUDA_SUCCESS);
    CHECK(kernel_log().empty());
    Gate gate;
    gate.hold(stream);
    REQUIRE(cuGraphLaunch(exec, stream) == CUDA_SUCCESS);
    gpu.launch(stream, 1000);
    CHECK(seen == 0);
    gate.open();
    REQUIRE(cuStreamSynchronize(stream) == CUDA_SUCCESS);
    CHECK(seen == 9);
    CHECK(words[1] == 9);
    CHECK(words[2] == 0);  // between the rows
    CHECK(words[5] == 9);
    CHECK(kernel_log().size() == 2);
}

TEST_CASE("Graph takes the stream's priority when it is launched there", "[unit][simgpu]") {
    const SimGpu gpu;
    const Builder builder(gpu);
    const CUgraphNode node = builder.kernel(1000);
    CUkernelNodeAttrValue value{};
    value.priority = -3;
    REQUIRE(cuGraphKernelNodeSetAttribute(node, CU_LAUNCH_ATTRIBUTE_PRIORITY, &value) ==
            CUDA_SUCCESS);
    value.priority = 0;
    REQUIRE(cuGraphKernelNodeGetAttribute(node, CU_LAUNCH_ATTRIBUTE_PRIORITY, &value) ==
            CUDA_SUCCESS);
    CHECK(value.priority == -3);
    const bool own = GENERATE(false, true);
    const CUgraphExec exec =
        builder.instantiate(own ? CUDA_GRAPH_INSTANTIATE_FLAG_USE_NODE_PRIORITY : 0);
    const CUstream stream = gpu.stream(CU_STREAM_NON_BLOCKING, -1);
    REQUIRE(cuGraphLaunch(exec, stream) == CUDA_SUCCESS);
    CUstreamAttrValue priority{};
    priority.priority = -5;
    REQUIRE(cuStreamSetAttribute(stream, CU_STREAM_ATTRIBUTE_PRIORITY, &priority) == CUDA_SUCCESS);
    REQUIRE(cuGraphLaunch(exec, stream) == CUDA_SUCCESS);
    REQUIRE(cuStreamSynchronize(stream) == CUDA_SUCCESS);
    const auto log = kernel_log();
    REQUIRE(log.size() == 2);
    CHECK(log[0].priority == (own ? -3 : -1));
    CHECK(log[1].priority == (own ? -3 : -5));
}

TEST_CASE("Captured node keeps the stream's priority when it is asked", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream(CU_STREAM_NON_BLOCKING, -2);
    REQUIRE(cuStreamBeginCapture(stream, CU_STREAM_CAPTURE_MODE_RELAXED) == CUDA_SUCCESS);
    REQUIRE(gpu.launch(stream, 1000) == CUDA_SUCCESS);
    CUgraph graph = nullptr;
    REQUIRE(cuStreamEndCapture(stream, &graph) == CUDA_SUCCESS);
    CUgraphNode node = nullptr;
    std::size_t count = 1;
    REQUIRE(cuGraphGetNodes(graph, &node, &count) == CUDA_SUCCESS);
    CUkernelNodeAttrValue value{};
    CHECK(cuGraphKernelNodeGetAttribute(node, CU_LAUNCH_ATTRIBUTE_PRIORITY, &value) ==
          CUDA_SUCCESS);
    CHECK(value.priority == -2);
}

TEST_CASE("Branches of a graph run side by side when nothing orders them", "[unit][simgpu]") {
    const SimGpu gpu;
    const Builder builder(gpu);
    constexpr std::uint64_t kLong_ns = 20'000'000;  // a busy machine's threads come late
    const CUgraphNode left = builder.kernel(kLong_ns);
    const CUgraphNode right = builder.kernel(kLong_ns);
    const CUgraphNode last = builder.kernel(1000, {left});
    REQUIRE(cuGraphAddDependencies(builder.graph, &right, &last, nullptr, 1) == CUDA_SUCCESS);
    CHECK(cuGraphAddDependencies(builder.graph, &right, &last, nullptr, 1) ==
          CUDA_ERROR_INVALID_VALUE);
    REQUIRE(cuGraphLaunch(builder.instantiate(), nullptr) == CUDA_SUCCESS);
    REQUIRE(gpu.launch(nullptr, 1000) == CUDA_SUCCESS);
    REQUIRE(cuCtxSynchronize() == CUDA_SUCCESS);
    const auto log = kernel_log();
    REQUIRE(log.size() == 4);
    CHECK(log[0].start_ns < log[1].end_ns);
    CHECK(log[1].start_ns < log[0].end_ns);
    CHECK(log[2].start_ns >= std::max(log[0].end_ns, log[1].end_ns));
    CHECK(log[3].start_ns >= log[2].end_ns);

    REQUIRE(cuGraphAddDependencies(builder.graph, &last, &left, nullptr, 1) == CUDA_SUCCESS);
    CUgraphExec exec = nullptr;
    CHECK(cuGraphInstantiate(&exec, builder.graph, 0) == CUDA_ERROR_INVALID_VALUE);  // a cycle
}

TEST_CASE("Kernel node runs with new parameters when they are set", "[unit][simgpu]") {
    const SimGpu gpu;
    const Builder builder(gpu);
    const CUgraphNode node = builder.kernel(1000);
    const CUgraphExec before = builder.instantiate();
    CUDA_KERNEL_NODE_PARAMS found{};
    REQUIRE(cuGraphKernelNodeGetParams(node, &found) == CUDA_SUCCESS);
    CHECK(found.func == gpu.function("unit"));
    CHECK(found.blockDimX == 32);
    unsigned ns = 5000;
    void* params[1];
    const auto wanted = builder.kernel_params(ns, params, 3);
    REQUIRE(cuGraphKernelNodeSetParams(node, &wanted) == CUDA_SUCCESS);
    const CUgraphExec after = builder.instantiate();
    ns = 1;  // taken when it was set
    REQUIRE(cuGraphLaunch(before, nullptr) == CUDA_SUCCESS);
    REQUIRE(cuGraphLaunch(after, nullptr) == CUDA_SUCCESS);
    ns = 7000;
    REQUIRE(cuGraphExecKernelNodeSetParams(before, node, &wanted) == CUDA_SUCCESS);
    REQUIRE(cuGraphLaunch(before, nullptr) == CUDA_SUCCESS);
    REQUIRE(cuCtxSynchronize() == CUDA_SUCCESS);
    const auto log = kernel_log();
    REQUIRE(log.size() == 3);
    CHECK(log[0].end_ns - log[0].start_ns == 1000);
    CHECK(log[1].end_ns - log[1].start_ns == 5000);
    CHECK(log[1].num_blocks == 3);
    CHECK(log[2].end_ns - log[2].start_ns == 7000);
}

TEST_CASE("Graph calls are refused when a handle is not alive", "[unit][simgpu]") {
    const SimGpu gpu;
    const Builder builder(gpu);
    const CUgraphNode node = builder.kernel(1000);
    REQUIRE(cuGraphDestroy(builder.graph) == CUDA_SUCCESS);
    CUgraphNodeType type{};
    CUgraphExec exec = nullptr;
    CHECK(cuGraphDestroy(builder.graph) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuGraphNodeGetType(node, &type) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuGraphInstantiate(&exec, builder.graph, 0) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuGraphLaunch(exec, nullptr) == CUDA_ERROR_INVALID_VALUE);
}
