// SPDX-License-Identifier: Apache-2.0
//
// Stream capture of the simulated driver.
#include <thread>

#include "tests/unit/test_simgpu_support.h"

// What cuCtxCreate means depends on the toolkit's version; this does not.
extern "C" CUresult cuCtxCreate_v2(CUcontext*, unsigned, CUdevice);

namespace {

CUstreamCaptureStatus status_of(CUstream stream) {
    CUstreamCaptureStatus status{};
    REQUIRE(cuStreamIsCapturing(stream, &status) == CUDA_SUCCESS);
    return status;
}

CUevent make_event() {
    CUevent event = nullptr;
    REQUIRE(cuEventCreate(&event, CU_EVENT_DISABLE_TIMING) == CUDA_SUCCESS);
    return event;
}

std::size_t num_nodes(CUgraph graph) {
    std::size_t count = 0;
    REQUIRE(cuGraphGetNodes(graph, nullptr, &count) == CUDA_SUCCESS);
    return count;
}

/// Does what a capture of the given mode may not see.
using UnsafeCall = CUresult (*)(const SimGpu&, CUevent);
const UnsafeCall kUnsafeCalls[] = {
    [](const SimGpu&, CUevent) {
        CUdeviceptr pointer = 0;
        return cuMemAlloc(&pointer, 64);
    },
    [](const SimGpu&, CUevent) {
        CUmodule module = nullptr;
        return cuModuleLoadData(&module, "{}");
    },
    [](const SimGpu&, CUevent) { return cuCtxSynchronize(); },
    [](const SimGpu& gpu, CUevent) {
        return cuStreamSynchronize(gpu.stream(CU_STREAM_NON_BLOCKING));
    },
    [](const SimGpu& gpu, CUevent) { return cuStreamQuery(gpu.stream(CU_STREAM_NON_BLOCKING)); },
    [](const SimGpu&, CUevent event) { return cuEventQuery(event); },
    [](const SimGpu&, CUevent event) { return cuEventSynchronize(event); },
};

}  // namespace

TEST_CASE("Work becomes nodes when its stream captures", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    CUdeviceptr memory = 0;
    REQUIRE(cuMemAlloc(&memory, 64) == CUDA_SUCCESS);
    CHECK(status_of(stream) == CU_STREAM_CAPTURE_STATUS_NONE);
    CUgraph graph = nullptr;
    CHECK(cuStreamEndCapture(stream, &graph) == CUDA_ERROR_ILLEGAL_STATE);
    REQUIRE(cuStreamBeginCapture(stream, CU_STREAM_CAPTURE_MODE_GLOBAL) == CUDA_SUCCESS);
    CHECK(cuStreamBeginCapture(stream, CU_STREAM_CAPTURE_MODE_GLOBAL) == CUDA_ERROR_ILLEGAL_STATE);
    CHECK(status_of(stream) == CU_STREAM_CAPTURE_STATUS_ACTIVE);
    REQUIRE(gpu.launch(stream, 1000) == CUDA_SUCCESS);
    REQUIRE(cuMemsetD8Async(memory, 7, 64, stream) == CUDA_SUCCESS);
    CUstreamCaptureStatus status{};
    cuuint64_t id = 0;
    CUgraph under_way = nullptr;
    const CUgraphNode* dependencies = nullptr;
    std::size_t num_dependencies = 0;
    REQUIRE(cuStreamGetCaptureInfo(stream, &status, &id, &under_way, &dependencies, nullptr,
                                   &num_dependencies) == CUDA_SUCCESS);
    CHECK(id != 0);
    REQUIRE(num_dependencies == 1);
    CUgraphNodeType type{};
    CHECK(cuGraphNodeGetType(dependencies[0], &type) == CUDA_SUCCESS);
    CHECK(type == CU_GRAPH_NODE_TYPE_MEMSET);
    REQUIRE(cuStreamEndCapture(stream, &graph) == CUDA_SUCCESS);
    CHECK(graph == under_way);
    CHECK(status_of(stream) == CU_STREAM_CAPTURE_STATUS_NONE);
    CHECK(num_nodes(graph) == 2);
    REQUIRE(cuCtxSynchronize() == CUDA_SUCCESS);
    CHECK(kernel_log().empty());

    CUgraphExec exec = nullptr;
    REQUIRE(cuGraphInstantiate(&exec, graph, 0) == CUDA_SUCCESS);
    REQUIRE(cuGraphDestroy(graph) == CUDA_SUCCESS);
    for (int i = 0; i < 2; ++i) REQUIRE(cuGraphLaunch(exec, stream) == CUDA_SUCCESS);
    REQUIRE(cuStreamSynchronize(stream) == CUDA_SUCCESS);
    CHECK(kernel_log().size() == 2);
    unsigned char value = 0;
    CHECK(cuMemcpyDtoH(&value, memory + 63, 1) == CUDA_SUCCESS);
    CHECK(value == 7);
    CHECK(cuGraphExecDestroy(exec) == CUDA_SUCCESS);
}

TEST_CASE("Streams join a capture when they wait for its events", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream origin = gpu.stream();
    const CUstream side = gpu.stream();
    const CUevent fork = make_event();
    const CUevent join = make_event();
    REQUIRE(cuStreamBeginCapture(origin, CU_STREAM_CAPTURE_MODE_GLOBAL) == CUDA_SUCCESS);
    REQUIRE(gpu.launch(origin, 1000) == CUDA_SUCCESS);
    REQUIRE(cuEventRecord(fork, origin) == CUDA_SUCCESS);
    REQUIRE(cuStreamWaitEvent(side, fork, 0) == CUDA_SUCCESS);
    CHECK(status_of(side) == CU_STREAM_CAPTURE_STATUS_ACTIVE);
    REQUIRE(gpu.launch(side, 500000) == CUDA_SUCCESS);
    REQUIRE(gpu.launch(origin, 500000) == CUDA_SUCCESS);
    CUgraph graph = nullptr;
    SECTION("and are joined again") {
        CHECK(cuStreamEndCapture(side, &graph) == CUDA_ERROR_STREAM_CAPTURE_UNMATCHED);
        REQUIRE(cuEventRecord(join, side) == CUDA_SUCCESS);
        REQUIRE(cuStreamWaitEvent(origin, join, 0) == CUDA_SUCCESS);
        REQUIRE(gpu.launch(origin, 1000) == CUDA_SUCCESS);
        REQUIRE(cuStreamEndCapture(origin, &graph) == CUDA_SUCCESS);
        CHECK(status_of(side) == CU_STREAM_CAPTURE_STATUS_NONE);
        CHECK(num_nodes(graph) == 4);
        CHECK(cuEventQuery(join) == CUDA_ERROR_CAPTURED_EVENT);

        CUgraphExec exec = nullptr;
        REQUIRE(cuGraphInstantiate(&exec, graph, 0) == CUDA_SUCCESS);
        REQUIRE(cuGraphLaunch(exec, origin) == CUDA_SUCCESS);
        REQUIRE(gpu.launch(origin, 1000) == CUDA_SUCCESS);
        REQUIRE(cuStreamSynchronize(origin) == CUDA_SUCCESS);
        const auto log = kernel_log();
        REQUIRE(log.size() == 5);
        // The two in the middle run side by side, the last of the graph after both.
        CHECK(log[1].start_ns < log[2].end_ns);
        CHECK(log[2].start_ns < log[1].end_ns);
        CHECK(log[3].start_ns >= log[1].end_ns);
        CHECK(log[3].start_ns >= log[2].end_ns);
        CHECK(log[4].start_ns >= log[3].end_ns);
    }
    SECTION("but are not joined again") {
        CHECK(cuStreamEndCapture(origin, &graph) == CUDA_ERROR_STREAM_CAPTURE_UNJOINED);
        CHECK(graph == nullptr);
        CHECK(status_of(side) == CU_STREAM_CAPTURE_STATUS_NONE);
    }
}

TEST_CASE("Capture is invalid when a call that it cannot take is made beside it",
          "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    const CUevent event = make_event();
    const int which = GENERATE(0, 1, 2, 3, 4, 5, 6);
    const UnsafeCall call = kUnsafeCalls[which];
    const bool waits_for_context = which == 2;  // refused in every mode
    const bool in_another_thread = GENERATE(false, true);
    const auto mode = GENERATE(CU_STREAM_CAPTURE_MODE_GLOBAL, CU_STREAM_CAPTURE_MODE_THREAD_LOCAL,
                               CU_STREAM_CAPTURE_MODE_RELAXED);
    const auto callers = GENERATE(CU_STREAM_CAPTURE_MODE_GLOBAL, CU_STREAM_CAPTURE_MODE_RELAXED);
    const bool refused = waits_for_context ||
                         (callers != CU_STREAM_CAPTURE_MODE_RELAXED &&
                          (mode == CU_STREAM_CAPTURE_MODE_GLOBAL ||
                           (mode == CU_STREAM_CAPTURE_MODE_THREAD_LOCAL && !in_another_thread)));
    REQUIRE(cuStreamBeginCapture(stream, mode) == CUDA_SUCCESS);
    const auto run = [&] {
        CUstreamCaptureMode own = callers;
        CHECK(cuThreadExchangeStreamCaptureMode(&own) == CUDA_SUCCESS);
        CHECK(own == CU_STREAM_CAPTURE_MODE_GLOBAL);
        CHECK(call(gpu, event) == (refused ? CUDA_ERROR_STREAM_CAPTURE_UNSUPPORTED : CUDA_SUCCESS));
        CHECK(cuThreadExchangeStreamCaptureMode(&own) == CUDA_SUCCESS);
    };
    if (in_another_thread) {
        std::thread([&] {
            cuCtxSetCurrent(gpu.context);
            run();
        }).join();
    } else {
        run();
    }
    CHECK(gpu.launch(stream, 1000) ==
          (refused ? CUDA_ERROR_STREAM_CAPTURE_INVALIDATED : CUDA_SUCCESS));
    CHECK(status_of(stream) ==
          (refused ? CU_STREAM_CAPTURE_STATUS_INVALIDATED : CU_STREAM_CAPTURE_STATUS_ACTIVE));
    CUgraph graph = nullptr;
    CHECK(cuStreamEndCapture(stream, &graph) ==
          (refused ? CUDA_ERROR_STREAM_CAPTURE_INVALIDATED : CUDA_SUCCESS));
    CHECK((graph == nullptr) == refused);
}

TEST_CASE("Capture is invalid when the stream itself is asked to wait", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    REQUIRE(cuStreamBeginCapture(stream, CU_STREAM_CAPTURE_MODE_RELAXED) == CUDA_SUCCESS);
    CHECK((GENERATE(false, true) ? cuStreamQuery(stream) : cuStreamSynchronize(stream)) ==
          CUDA_ERROR_STREAM_CAPTURE_UNSUPPORTED);
    CUgraph graph = nullptr;
    CHECK(cuStreamEndCapture(stream, &graph) == CUDA_ERROR_STREAM_CAPTURE_INVALIDATED);
}

TEST_CASE("Legacy stream invalidates a capture when the capturing stream waits for it",
          "[unit][simgpu]") {
    const SimGpu gpu;
    const bool blocking = GENERATE(true, false);
    const CUstream stream = gpu.stream(blocking ? CU_STREAM_DEFAULT : CU_STREAM_NON_BLOCKING);
    CHECK(cuStreamBeginCapture(nullptr, CU_STREAM_CAPTURE_MODE_RELAXED) ==
          CUDA_ERROR_STREAM_CAPTURE_UNSUPPORTED);
    REQUIRE(cuStreamBeginCapture(stream, CU_STREAM_CAPTURE_MODE_RELAXED) == CUDA_SUCCESS);
    CUstreamCaptureStatus status{};
    CHECK(cuStreamIsCapturing(nullptr, &status) ==
          (blocking ? CUDA_ERROR_STREAM_CAPTURE_IMPLICIT : CUDA_SUCCESS));
    CHECK(status_of(stream) == CU_STREAM_CAPTURE_STATUS_ACTIVE);  // asking did no harm
    CHECK(gpu.launch(nullptr, 1000) ==
          (blocking ? CUDA_ERROR_STREAM_CAPTURE_IMPLICIT : CUDA_SUCCESS));
    CUgraph graph = nullptr;
    CHECK(cuStreamEndCapture(stream, &graph) ==
          (blocking ? CUDA_ERROR_STREAM_CAPTURE_INVALIDATED : CUDA_SUCCESS));
}

TEST_CASE("Capture is refused what crosses its border when events are waited for",
          "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream first = gpu.stream();
    const CUstream second = gpu.stream();
    const CUevent outside = make_event();
    const CUevent inside = make_event();
    const CUevent never = make_event();
    REQUIRE(cuEventRecord(outside, second) == CUDA_SUCCESS);
    REQUIRE(cuStreamBeginCapture(first, CU_STREAM_CAPTURE_MODE_RELAXED) == CUDA_SUCCESS);
    REQUIRE(cuStreamBeginCapture(second, CU_STREAM_CAPTURE_MODE_RELAXED) == CUDA_SUCCESS);
    CHECK(cuStreamWaitEvent(first, never, 0) == CUDA_SUCCESS);
    CUgraph graph = nullptr;
    SECTION("of another capture") {
        REQUIRE(cuEventRecord(inside, first) == CUDA_SUCCESS);
        CHECK(cuStreamWaitEvent(second, inside, 0) == CUDA_ERROR_STREAM_CAPTURE_MERGE);
    }
    SECTION("of no capture") {
        CHECK(cuStreamWaitEvent(second, outside, 0) == CUDA_ERROR_STREAM_CAPTURE_ISOLATION);
    }
    CHECK(cuStreamEndCapture(second, &graph) == CUDA_ERROR_STREAM_CAPTURE_INVALIDATED);
    cuStreamEndCapture(first, &graph);
}

TEST_CASE("Capture ends in its own thread when it is not relaxed", "[unit][simgpu]") {
    const SimGpu gpu;
    const bool relaxed = GENERATE(false, true);
    const CUstream stream = gpu.stream();
    REQUIRE(cuStreamBeginCapture(stream, relaxed ? CU_STREAM_CAPTURE_MODE_RELAXED
                                                 : CU_STREAM_CAPTURE_MODE_THREAD_LOCAL) ==
            CUDA_SUCCESS);
    CUgraph graph = nullptr;
    CUresult result{};
    std::thread([&] { result = cuStreamEndCapture(stream, &graph); }).join();
    CHECK(result == (relaxed ? CUDA_SUCCESS : CUDA_ERROR_STREAM_CAPTURE_WRONG_THREAD));
    if (!relaxed) CHECK(cuStreamEndCapture(stream, &graph) == CUDA_SUCCESS);
}

TEST_CASE("Capture ends with its context, and a thread's own stream's with the thread",
          "[unit][simgpu]") {
    const SimGpu gpu;
    CUdeviceptr memory = 0;
    CUcontext other = nullptr;
    REQUIRE(cuCtxCreate_v2(&other, 0, 0) == CUDA_SUCCESS);
    CUstream stream = nullptr;
    REQUIRE(cuStreamCreate(&stream, CU_STREAM_NON_BLOCKING) == CUDA_SUCCESS);
    REQUIRE(cuStreamBeginCapture(stream, CU_STREAM_CAPTURE_MODE_GLOBAL) == CUDA_SUCCESS);
    REQUIRE(cuCtxDestroy(other) == CUDA_SUCCESS);
    REQUIRE(cuCtxSetCurrent(gpu.context) == CUDA_SUCCESS);
    CHECK(cuMemAlloc(&memory, 64) == CUDA_SUCCESS);
    std::thread([&] {
        CHECK(cuCtxSetCurrent(gpu.context) == CUDA_SUCCESS);
        CHECK(cuStreamBeginCapture(CU_STREAM_PER_THREAD, CU_STREAM_CAPTURE_MODE_GLOBAL) ==
              CUDA_SUCCESS);
    }).join();
    CHECK(cuMemAlloc(&memory, 64) == CUDA_SUCCESS);
    REQUIRE(cuStreamCreate(&stream, CU_STREAM_NON_BLOCKING) == CUDA_SUCCESS);
    std::thread([&] {
        CHECK(cuCtxSetCurrent(gpu.context) == CUDA_SUCCESS);
        CHECK(cuStreamBeginCapture(stream, CU_STREAM_CAPTURE_MODE_GLOBAL) == CUDA_SUCCESS);
    }).join();
    CHECK(status_of(stream) == CU_STREAM_CAPTURE_STATUS_ACTIVE);
    CHECK(cuStreamDestroy(stream) == CUDA_SUCCESS);
}
