// SPDX-License-Identifier: Apache-2.0
//
// Captures that nobody ends: they end with their stream, its context, or its thread. What comes
// after them is as if they had never been.
#include <string>
#include <thread>
#include <vector>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

// cuCtxDetach: old, and still there.
#pragma GCC diagnostic ignored "-Wdeprecated-declarations"

namespace twin {
namespace {

/// Begins a capture, in the mode that forbids most, on a stream of another context, which goes.
void leave_in_context(const Gpu& gpu, bool detach) {
    const CUcontext other = make_context();
    const CUstream stream = make_stream();
    SHOW(cuStreamBeginCapture(stream, CU_STREAM_CAPTURE_MODE_GLOBAL));
    SHOW(detach ? cuCtxDetach(other) : cuCtxDestroy(other));
    SHOW(cuCtxSetCurrent(gpu.context));
}

void leave_in_reset_device() {
    const Gpu gpu;
    const CUstream stream = make_stream();
    SHOW(cuStreamBeginCapture(stream, CU_STREAM_CAPTURE_MODE_GLOBAL));
    SHOW(cuDevicePrimaryCtxReset(0));
}

void leave_in_thread(const Gpu& gpu) {
    std::thread([&] {
        SHOW(cuCtxSetCurrent(gpu.context));
        SHOW(cuStreamBeginCapture(CU_STREAM_PER_THREAD, CU_STREAM_CAPTURE_MODE_GLOBAL));
        SHOW(launch_tiny(gpu.tiny, CU_STREAM_PER_THREAD));
    }).join();
}

void leave_in_stream() {
    const CUstream stream = make_stream();
    SHOW(cuStreamBeginCapture(stream, CU_STREAM_CAPTURE_MODE_GLOBAL));
    SHOW(cuStreamDestroy(stream));
}

/// @returns the driver's function; null if it has none
void* recapture_entry() {
    void* entry = nullptr;
    CUdriverProcAddressQueryResult found{};
    const bool known =
        cuGetProcAddress("cuStreamBeginRecaptureToGraph", &entry, 13030, 0, &found) == 0;
    return known ? entry : nullptr;
}

/// @param where  what the capture ends with: context, detach, reset, thread, stream; or nothing
///               captures: none, asked (for an entry that would)
void leave_capture(const std::string& where) {
    if (where == "asked" && !recapture_entry()) give_up("no entry", 0);
    if (where == "reset") leave_in_reset_device();
    const Gpu gpu;
    if (where == "context" || where == "detach") leave_in_context(gpu, where == "detach");
    if (where == "thread") leave_in_thread(gpu);
    if (where == "stream") leave_in_stream();
    CUdeviceptr memory = 0;
    SHOW(cuMemAlloc(&memory, 64));  // what a capture would forbid
    const CUstream stream = make_stream();
    std::uint64_t* to = make_mapped(2);
    int sum = 0;
    for (int frame = 0; frame < 10; ++frame) {
        for (int i = 0; i < 20; ++i) sum += launch_tiny(gpu.tiny, stream);
        sum += launch_store(gpu.store, to, 10 + std::uint64_t(frame), stream);
        sum += cuStreamSynchronize(stream);
    }
    say("%d, %d", sum, int(to[0]));
}

// @param arguments  as leave_capture()'s; none: one after the other
int left_captures(const Arguments& arguments) {
    MUST(cuInit(0));
    const Arguments all{"none", "context", "detach", "reset", "thread", "stream"};
    for (const std::string& where : arguments.empty() ? all : arguments) leave_capture(where);
    return 0;
}

/// What the nodes are, and at which priority they were captured.
void say_nodes(CUgraph graph) {
    std::size_t count = 0;
    SHOW(cuGraphGetNodes(graph, nullptr, &count));
    std::vector<CUgraphNode> nodes(count);
    MUST(cuGraphGetNodes(graph, nodes.data(), &count));
    for (CUgraphNode node : nodes) {
        CUgraphNodeType type{};
        CUkernelNodeAttrValue value{};
        MUST(cuGraphNodeGetType(node, &type));
        if (type == CU_GRAPH_NODE_TYPE_KERNEL)
            MUST(cuGraphKernelNodeGetAttribute(node, CU_LAUNCH_ATTRIBUTE_PRIORITY, &value));
        say("node of type %d, priority %d", int(type), value.priority);
    }
}

// A capture by an entry that is newer than UrgenGo: between launches that are scheduled.
int recapture(const Arguments&) {
    using Recapture =
        CUresult (*)(CUstream, CUstreamCaptureMode, CUgraph, void (*)(), void* user_data);
    MUST(cuInit(0));
    const auto begin = reinterpret_cast<Recapture>(recapture_entry());
    if (!begin) return kNotForThisGpu;
    const Gpu gpu;
    const CUstream stream = make_stream(CU_STREAM_NON_BLOCKING, -2);
    std::uint64_t* to = make_mapped(2);
    CUgraph graph = nullptr, again = nullptr;
    SHOW(cuGraphCreate(&graph, 0));
    SHOW(begin(stream, CU_STREAM_CAPTURE_MODE_RELAXED, nullptr, nullptr, nullptr));
    for (std::uint64_t value = 1; value < 4; ++value) {
        for (int i = 0; i < 6; ++i) MUST(launch_wide(gpu.wide, stream));
        SHOW(begin(stream, CU_STREAM_CAPTURE_MODE_RELAXED, graph, nullptr, nullptr));
        for (int i = 0; i < 8; ++i) MUST(launch_wide(gpu.wide, stream));
        SHOW(launch_store(gpu.store, to, value, stream));
        SHOW(cuStreamEndCapture(stream, &again));
        say("the same: %d", again == graph);
        say_nodes(graph);
        CUgraphExec exec = nullptr;
        MUST(cuGraphInstantiateWithFlags(&exec, graph, 0));
        SHOW(cuGraphLaunch(exec, stream));
        SHOW(cuStreamSynchronize(stream));
        say("%d", int(to[0]));
    }
    return 0;
}

const Scenario s2("recapture", recapture);
const Scenario s1("left_captures", left_captures);

}  // namespace
}  // namespace twin
