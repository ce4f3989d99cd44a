// SPDX-License-Identifier: Apache-2.0
//
// Graphs: built by hand, updated, cloned, with children, memory and conditions, and launched on
// every kind of stream.
#include <thread>
#include <vector>

#include "tests/interposer/gpu.h"
#include "tests/interposer/graphs.h"
#include "tests/interposer/kernel_log.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

CUDA_KERNEL_NODE_PARAMS store_params(const Gpu& gpu, void** parameters) {
    CUDA_KERNEL_NODE_PARAMS params{};
    params.func = gpu.store;
    params.gridDimX = params.gridDimY = params.gridDimZ = 1;
    params.blockDimX = params.blockDimY = params.blockDimZ = 1;
    params.kernelParams = parameters;
    return params;
}

void run_graph(CUgraphExec exec, CUstream stream, const std::uint64_t* to) {
    SHOW(cuGraphLaunch(exec, stream));
    SHOW(cuStreamSynchronize(stream));
    say("%d", int(to[0]));
}

// One executable graph changed after another graph, node by node, and refused.
int graph_updates(const Arguments&) {
    const Gpu gpu;
    std::uint64_t* to = make_mapped(2);
    const CUstream stream = make_stream(CU_STREAM_NON_BLOCKING, -2);
    const CUgraph first = capture(gpu, stream, to, 1), second = capture(gpu, stream, to, 2);
    const CUgraphExec exec = instantiate(first);
    run_graph(exec, stream, to);
    CUgraphExecUpdateResultInfo info{};
    SHOW(cuGraphExecUpdate(exec, second, &info));
    say("update %d", int(info.result));
    run_graph(exec, stream, to);
    MUST(cuStreamBeginCapture(stream, CU_STREAM_CAPTURE_MODE_GLOBAL));
    MUST(launch_wide(gpu.wide, stream));
    CUgraph shorter = nullptr;
    MUST(cuStreamEndCapture(stream, &shorter));
    SHOW(cuGraphExecUpdate(exec, shorter, &info));
    say("update %d", int(info.result));
    run_graph(exec, stream, to);

    CUgraphNode nodes[3] = {};
    std::size_t count = 3;
    MUST(cuGraphGetNodes(first, nodes, &count));
    CUdeviceptr d_to = on_gpu(to);
    std::uint64_t value = 3;
    void* parameters[] = {&d_to, &value, &value};
    const auto params = store_params(gpu, parameters);
    SHOW(cuGraphExecKernelNodeSetParams(exec, nodes[1], &params));
    run_graph(exec, stream, to);
    SHOW(cuGraphNodeSetEnabled(exec, nodes[1], 0));
    to[0] = 0;
    run_graph(exec, stream, to);
    SHOW(cuGraphNodeSetEnabled(exec, nodes[1], 1));
    run_graph(exec, stream, to);

    CUgraph clone = nullptr;
    CUgraphNode cloned = nullptr;
    value = 4;
    SHOW(cuGraphClone(&clone, first));
    SHOW(cuGraphNodeFindInClone(&cloned, nodes[1], clone));
    SHOW(cuGraphKernelNodeSetParams(cloned, &params));
    run_graph(instantiate(clone), stream, to);
    run_graph(instantiate(first), stream, to);
    SHOW(cuGraphUpload(exec, stream));
    SHOW(cuGraphExecDestroy(exec));
    if (simulated()) SHOW(cuGraphLaunch(exec, stream));  // else undefined
    say_priority(stream);
    return 0;
}

// Child graphs, by hand and captured; memory of a graph; conditionals.
int graph_nodes(const Arguments&) {
    const Gpu gpu;
    std::uint64_t* to = make_mapped(2);
    const CUstream stream = make_stream(CU_STREAM_NON_BLOCKING, -1);
    const CUgraph child = capture(gpu, stream, to, 7);
    CUgraph graph = nullptr, inner = nullptr;
    CUgraphNode node = nullptr, last = nullptr;
    MUST(cuGraphCreate(&graph, 0));
    SHOW(cuGraphAddChildGraphNode(&node, graph, nullptr, 0, child));
    SHOW(cuGraphAddEmptyNode(&last, graph, &node, 1));
    SHOW(cuGraphChildGraphNodeGetGraph(node, &inner));
    say_nodes(inner);
    say_nodes(graph);
    run_graph(instantiate(graph), stream, to);
    // A graph cannot be launched into a capture.
    const CUgraphExec exec = instantiate(child);
    SHOW(cuStreamBeginCapture(stream, CU_STREAM_CAPTURE_MODE_GLOBAL));
    SHOW(launch_store(gpu.store, to, 8, stream));
    SHOW(cuGraphLaunch(exec, stream));
    SHOW(cuStreamEndCapture(stream, &graph));
    SHOW(cuGraphLaunch(exec, stream));
    SHOW(cuStreamSynchronize(stream));
    say_priority(stream);

    // Memory that the graph allocates, uses and frees; then one that the program frees.
    for (const bool frees : {true, false}) {
        CUdeviceptr memory = 0;
        SHOW(cuStreamBeginCapture(stream, CU_STREAM_CAPTURE_MODE_GLOBAL));
        SHOW(cuMemAllocAsync(&memory, 1024, stream));
        SHOW(cuMemsetD32Async(memory, 9, 2, stream));
        SHOW(launch_wide(gpu.wide, stream));
        SHOW(cuMemcpyAsync(on_gpu(to), memory, 8, stream));
        if (frees) SHOW(cuMemFreeAsync(memory, stream));
        SHOW(cuStreamEndCapture(stream, &graph));
        say_nodes(graph);
        const CUgraphExec with_memory = instantiate(graph);
        run_graph(with_memory, stream, to);
        SHOW(cuGraphLaunch(with_memory, stream));
        if (!frees) SHOW(cuMemFreeAsync(memory, stream));
        run_graph(with_memory, stream, to);
    }

    // A body that runs, and one that does not.
    for (const unsigned value : {1u, 0u}) {
        CUgraphConditionalHandle condition = 0;
        CUgraphNodeParams params{};
        to[0] = 0;
        MUST(cuGraphCreate(&graph, 0));
        SHOW(cuGraphConditionalHandleCreate(&condition, graph, gpu.context, value,
                                            CU_GRAPH_COND_ASSIGN_DEFAULT));
        params.type = CU_GRAPH_NODE_TYPE_CONDITIONAL;
        params.conditional.handle = condition;
        params.conditional.type = CU_GRAPH_COND_TYPE_IF;
        params.conditional.size = 1;
        params.conditional.ctx = gpu.context;
        SHOW(cuGraphAddNode(&node, graph, nullptr, nullptr, 0, &params));
        const CUgraph body = params.conditional.phGraph_out[0];
        SHOW(cuStreamBeginCaptureToGraph(stream, body, nullptr, nullptr, 0,
                                         CU_STREAM_CAPTURE_MODE_GLOBAL));
        SHOW(launch_wide(gpu.wide, stream));
        SHOW(launch_store(gpu.store, to, 77, stream));
        SHOW(cuStreamEndCapture(stream, nullptr));
        CUgraph ended = nullptr;
        SHOW(cuStreamEndCapture(stream, &ended));
        say("same %d", ended == body);
        run_graph(instantiate(graph), stream, to);
    }
    return 0;
}

// On every kind of stream, again and again, from several threads, each with its own executable.
int graph_streams(const Arguments&) {
    const Gpu gpu;
    std::uint64_t* to = make_mapped(2);
    const CUstream blocking = make_stream(CU_STREAM_DEFAULT, -1), other = make_stream();
    const CUgraph graph = capture(gpu, other, to, 5);
    const CUgraphExec exec = instantiate(graph);
    const auto launch_per_thread = reinterpret_cast<CUresult (*)(CUgraphExec, CUstream)>(
        entry_point("cuGraphLaunch", 10000, CU_GET_PROC_ADDRESS_PER_THREAD_DEFAULT_STREAM));
    for (CUstream stream :
         {CUstream(nullptr), CU_STREAM_PER_THREAD, CU_STREAM_LEGACY, blocking, other}) {
        to[0] = 0;
        SHOW(launch_wide(gpu.wide, blocking));
        SHOW(cuGraphLaunch(exec, stream));
        SHOW(launch_per_thread(exec, stream));
        SHOW(launch_tiny(gpu.tiny, stream));
        SHOW(cuStreamSynchronize(stream));
        say("%d", int(to[0]));
        say_priority(stream);
    }
    std::vector<int> sums(4);
    std::vector<std::thread> threads;
    for (std::size_t t = 0; t < sums.size(); ++t)
        threads.emplace_back([&, t] {
            name_this_thread("twin_" + std::to_string(t));
            MUST(cuCtxSetCurrent(gpu.context));
            std::uint64_t* word = make_mapped(2);
            const CUstream stream = make_stream(CU_STREAM_NON_BLOCKING, -int(t));
            for (int i = 0; i < 5; ++i) {
                const CUgraph mine =
                    capture(gpu, stream, word, t, CU_STREAM_CAPTURE_MODE_THREAD_LOCAL);
                CUgraphExec own = nullptr;
                sums[t] += cuGraphInstantiateWithFlags(&own, mine, 0);
                for (int k = 0; k < 4; ++k) sums[t] += cuGraphLaunch(own, stream);
                sums[t] += launch_wide(gpu.wide, stream);
                sums[t] += cuStreamSynchronize(stream) + int(word[0]);
                int priority = 0;
                MUST(cuStreamGetPriority(stream, &priority));
                sums[t] += 100 * priority;
                sums[t] += cuGraphExecDestroy(own) + cuGraphDestroy(mine);
            }
        });
    for (std::thread& thread : threads) thread.join();
    for (const int sum : sums) say("%d", sum);
    return 0;
}

// The main thread's own long work keeps the GPU; a less urgent task's graph comes meanwhile.
int graph_held(const Arguments&) {
    const Gpu gpu;
    const CUstream own = make_stream();
    const CUfunction very_long = gpu.function("very_long");
    std::uint64_t* to = make_mapped(2);
    const CUstream stream = make_stream(CU_STREAM_NON_BLOCKING, -1);
    const CUgraphExec exec = instantiate(capture(gpu, stream, to, 11));
    for (int i = 0; i < 3; ++i) SHOW(launch_wide(very_long, own));
    std::thread([&] {
        name_this_thread("twin_1");
        SHOW(cuCtxSetCurrent(gpu.context));
        say_priority(stream);
        SHOW(cuGraphLaunch(exec, stream));
        say_priority(stream);
        SHOW(launch_wide(gpu.wide, stream));
        SHOW(cuStreamSynchronize(stream));
        say("%d", int(to[0]));
    }).join();
    SHOW(cuStreamSynchronize(own));
    return 0;
}

// What a captured node remembers is the program's: its priority shows when the graph uses it, in
// launches of a thread that is of no chain, and where the nodes have several.
int graph_node_priorities(const Arguments&) {
    const Gpu gpu;
    const CUstream captured = make_stream(CU_STREAM_NON_BLOCKING, -2);
    const CUfunction chosen = gpu.function("chosen");
    const auto launch_on_both = [&](CUgraphExec exec) {
        cuuint64_t flags = 0;
        SHOW(cuGraphExecGetFlags(exec, &flags));
        say("flags %d", int(flags));
        for (const int priority : {0, -2}) {
            const CUstream stream = make_stream(CU_STREAM_NON_BLOCKING, priority);
            for (int i = 0; i < 5; ++i) MUST(launch_wide(gpu.wide, stream));
            SHOW(cuGraphLaunch(exec, stream));
            say_priority(stream);
            SHOW(cuStreamSynchronize(stream));
        }
    };
    for (int i = 0; i < 5; ++i) MUST(launch_wide(gpu.wide, captured));
    CUgraph graph = nullptr;
    SHOW(cuStreamBeginCapture(captured, CU_STREAM_CAPTURE_MODE_THREAD_LOCAL));
    SHOW(launch_tiny(chosen, captured));
    SHOW(launch_tiny(chosen, captured));
    SHOW(cuStreamEndCapture(captured, &graph));
    say_nodes(graph);
    constexpr auto kOwn = CUDA_GRAPH_INSTANTIATE_FLAG_USE_NODE_PRIORITY;
    const CUgraphExec alike = instantiate(graph, kOwn);
    std::thread([&] {
        name_this_thread("passer_by");
        SHOW(cuCtxSetCurrent(gpu.context));
        launch_on_both(alike);
    }).join();

    CUgraphNode nodes[2] = {};
    std::size_t count = 2;
    CUkernelNodeAttrValue value{};
    value.priority = -4;
    MUST(cuGraphGetNodes(graph, nodes, &count));
    MUST(cuGraphKernelNodeSetAttribute(nodes[1], CU_LAUNCH_ATTRIBUTE_PRIORITY, &value));
    launch_on_both(instantiate(graph, kOwn));
    SHOW(cuGraphExecDestroy(alike));
    // Of all streams' priority now, perhaps with the handle that has become free.
    const CUgraphExec plain = instantiate(graph);
    std::thread([&] {
        name_this_thread("passer_by");
        SHOW(cuCtxSetCurrent(gpu.context));
        launch_on_both(plain);
    }).join();
    for (const simgpu_kernel_record& kernel : kernel_log("chosen"))
        say("chosen ran at %d", kernel.priority);
    return 0;
}

const Scenario s1("graph_updates", graph_updates), s2("graph_nodes", graph_nodes),
    s3("graph_streams", graph_streams), s4("graph_held", graph_held),
    s5("graph_node_priorities", graph_node_priorities, Runs::kSimulated);

}  // namespace
}  // namespace twin
