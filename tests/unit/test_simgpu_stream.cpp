// SPDX-License-Identifier: Apache-2.0
//
// Streams, events, host functions and stream memory operations of the simulated driver.
#include <atomic>
#include <chrono>
#include <thread>

#include "tests/unit/test_simgpu_support.h"

extern "C" CUresult cuLaunchKernel_ptsz(CUfunction, unsigned, unsigned, unsigned, unsigned,
                                        unsigned, unsigned, unsigned, CUstream, void**, void**);
extern "C" CUresult cuStreamSynchronize_ptsz(CUstream);

TEST_CASE("Stream has what it was created with when asked", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream(CU_STREAM_NON_BLOCKING, -9);
    int priority = 0;
    unsigned flags = 0;
    CUcontext context = nullptr;
    CHECK(cuStreamGetPriority(stream, &priority) == CUDA_SUCCESS);
    CHECK(priority == -5);
    CHECK(cuStreamGetFlags(stream, &flags) == CUDA_SUCCESS);
    CHECK(flags == CU_STREAM_NON_BLOCKING);
    CHECK(cuStreamGetCtx(stream, &context) == CUDA_SUCCESS);
    CHECK(context == gpu.context);
    CHECK(id_of(stream) != id_of(nullptr));
    CHECK(cuStreamCreate(nullptr, 0) == CUDA_ERROR_INVALID_VALUE);
    CUstream bad = nullptr;
    CHECK(cuStreamCreate(&bad, 4) == CUDA_ERROR_INVALID_VALUE);
}

TEST_CASE("Stream attribute changes the priority of later launches when it is set",
          "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    gpu.launch(stream, 1000);
    CUstreamAttrValue value{};
    value.priority = -4;
    REQUIRE(cuStreamSetAttribute(stream, CU_STREAM_ATTRIBUTE_PRIORITY, &value) == CUDA_SUCCESS);
    gpu.launch(stream, 1000);
    int priority = 0;
    CHECK(cuStreamGetPriority(stream, &priority) == CUDA_SUCCESS);
    CHECK(priority == -4);
    const CUstream copy = gpu.stream();
    CHECK(cuStreamCopyAttributes(copy, stream) == CUDA_SUCCESS);
    CHECK(cuStreamGetAttribute(copy, CU_STREAM_ATTRIBUTE_PRIORITY, &value) == CUDA_SUCCESS);
    CHECK(value.priority == -4);
    REQUIRE(cuStreamSynchronize(stream) == CUDA_SUCCESS);
    REQUIRE(kernel_log().size() == 2);
    CHECK(kernel_log()[0].priority == 0);
    CHECK(kernel_log()[1].priority == -4);
}

TEST_CASE("Legacy stream waits for blocking streams when work is queued on both",
          "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream blocking = gpu.stream(CU_STREAM_DEFAULT);
    Gate gate;
    gate.hold(blocking);
    gpu.launch(blocking, 2000000);
    gpu.launch(nullptr, 1000);
    gpu.launch(blocking, 1000);
    CHECK(cuStreamQuery(nullptr) == CUDA_ERROR_NOT_READY);
    gate.open();
    REQUIRE(cuStreamSynchronize(nullptr) == CUDA_SUCCESS);
    const auto log = kernel_log();
    REQUIRE(log.size() == 3);
    CHECK(log[1].stream_id == id_of(nullptr));
    CHECK(log[1].start_ns == log[0].end_ns);
    CHECK(log[2].start_ns >= log[1].end_ns);
    CHECK(cuStreamQuery(nullptr) == CUDA_SUCCESS);
}

TEST_CASE("Legacy stream's end is that of the blocking streams when it is synchronised",
          "[unit][simgpu]") {
    const SimGpu gpu;
    gpu.launch(gpu.stream(CU_STREAM_DEFAULT), 2000000);
    REQUIRE(cuStreamSynchronize(nullptr) == CUDA_SUCCESS);
    CHECK(kernel_log().size() == 1);
}

TEST_CASE("Non-blocking stream runs beside the legacy stream when both have work",
          "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream(CU_STREAM_NON_BLOCKING);
    Gate gate;
    gate.hold(nullptr);
    gpu.launch(nullptr, 1000);
    gpu.launch(stream, 1000);
    CHECK(cuStreamQuery(nullptr) == CUDA_ERROR_NOT_READY);
    for (int i = 0; i < 1000 && kernel_log().empty(); ++i) {
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    REQUIRE(kernel_log().size() == 1);
    CHECK(kernel_log()[0].stream_id == id_of(stream));
}

TEST_CASE("Per-thread default stream differs between threads when each launches",
          "[unit][simgpu]") {
    const SimGpu gpu;
    const CUfunction f = gpu.function("short");
    const auto launch = [f] {
        cuLaunchKernel_ptsz(f, 1, 1, 1, 32, 1, 1, 0, nullptr, nullptr, nullptr);
        cuStreamSynchronize_ptsz(nullptr);
    };
    launch();
    std::thread([&] {
        cuCtxSetCurrent(gpu.context);
        launch();
    }).join();
    const auto log = kernel_log();
    REQUIRE(log.size() == 2);
    CHECK(log[0].stream_id == id_of(CU_STREAM_PER_THREAD));
    CHECK(log[1].stream_id != log[0].stream_id);
    CHECK(log[1].stream_id != id_of(CU_STREAM_LEGACY));
}

TEST_CASE("Per-thread default stream takes turns with the legacy stream when both have work",
          "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream first = GENERATE(CU_STREAM_PER_THREAD, CU_STREAM_LEGACY);
    const CUstream second = first == CU_STREAM_LEGACY ? CU_STREAM_PER_THREAD : CU_STREAM_LEGACY;
    Gate gate;
    gate.hold(first);
    gpu.launch(first, 2000000);
    gpu.launch(second, 1000);
    gpu.launch(first, 1000);
    // Another thread's own stream waits for the legacy stream too, but not for this thread's.
    std::thread([&] {
        cuCtxSetCurrent(gpu.context);
        gpu.launch(CU_STREAM_PER_THREAD, 1000);
        CHECK(cuStreamQuery(CU_STREAM_PER_THREAD) == CUDA_ERROR_NOT_READY);
    }).join();
    CHECK(cuStreamQuery(second) == CUDA_ERROR_NOT_READY);
    gate.open();
    REQUIRE(cuCtxSynchronize() == CUDA_SUCCESS);
    const auto log = kernel_log();
    REQUIRE(log.size() == 4);
    CHECK(log[0].stream_id == id_of(first));
    CHECK(log[1].stream_id == id_of(second));
    CHECK(log[1].start_ns >= log[0].end_ns);
    for (std::size_t i = 2; i < log.size(); ++i) CHECK(log[i].start_ns >= log[1].end_ns);
}

TEST_CASE("Event measures simulated time when it is recorded around a kernel", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    CUevent start = nullptr;
    CUevent end = nullptr;
    CUevent untimed = nullptr;
    REQUIRE(cuEventCreate(&start, CU_EVENT_DEFAULT) == CUDA_SUCCESS);
    REQUIRE(cuEventCreate(&end, CU_EVENT_BLOCKING_SYNC) == CUDA_SUCCESS);
    REQUIRE(cuEventCreate(&untimed, CU_EVENT_DISABLE_TIMING) == CUDA_SUCCESS);
    float ms = -1;
    CHECK(cuEventQuery(start) == CUDA_SUCCESS);  // never recorded
    CHECK(cuEventElapsedTime(&ms, start, end) == CUDA_ERROR_INVALID_HANDLE);
    Gate gate;
    gate.hold(stream);
    gpu.launch(stream, 1000000);
    cuEventRecord(start, stream);
    gpu.launch(stream, 3000000);
    cuEventRecord(end, stream);
    cuEventRecord(untimed, stream);
    CHECK(cuEventQuery(end) == CUDA_ERROR_NOT_READY);
    CHECK(cuEventElapsedTime(&ms, start, end) == CUDA_ERROR_NOT_READY);
    gate.open();
    REQUIRE(cuEventSynchronize(untimed) == CUDA_SUCCESS);
    CHECK(cuEventQuery(end) == CUDA_SUCCESS);
    CHECK(cuEventElapsedTime(&ms, start, end) == CUDA_SUCCESS);
    CHECK(ms == Approx(3.002).epsilon(1e-6));
    CHECK(cuEventElapsedTime(&ms, start, untimed) == CUDA_ERROR_INVALID_HANDLE);
    void* found = nullptr;  // the one before CUDA 12.8, which cuda.h hides
    REQUIRE(cuGetProcAddress("cuEventElapsedTime", &found, 2000, 0, nullptr) == CUDA_SUCCESS);
    const auto elapsed_v1 = reinterpret_cast<CUresult (*)(float*, CUevent, CUevent)>(found);
    ms = -1;
    CHECK(elapsed_v1(&ms, start, end) == CUDA_SUCCESS);
    CHECK(ms == Approx(3.002).epsilon(1e-6));
    CHECK(elapsed_v1(&ms, untimed, end) == CUDA_ERROR_INVALID_HANDLE);
    CHECK(cuEventDestroy(start) == CUDA_SUCCESS);
    CHECK(cuEventDestroy(start) == CUDA_ERROR_INVALID_HANDLE);
}

TEST_CASE("Stream waits for another's event when told to", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream producer = gpu.stream();
    const CUstream consumer = gpu.stream();
    CUevent event = nullptr;
    REQUIRE(cuEventCreate(&event, CU_EVENT_DISABLE_TIMING) == CUDA_SUCCESS);
    Gate gate;
    gate.hold(producer);
    gpu.launch(producer, 2000000);
    cuEventRecord(event, producer);
    CHECK(cuStreamWaitEvent(consumer, event, CU_EVENT_WAIT_EXTERNAL) == CUDA_ERROR_ILLEGAL_STATE);
    CHECK(cuEventRecordWithFlags(event, producer, CU_EVENT_RECORD_EXTERNAL) ==
          CUDA_ERROR_ILLEGAL_STATE);
    REQUIRE(cuStreamWaitEvent(consumer, event, 0) == CUDA_SUCCESS);
    CHECK(cuEventDestroy(event) == CUDA_SUCCESS);  // the wait remains
    gpu.launch(consumer, 1000);
    gate.open();
    REQUIRE(cuStreamSynchronize(consumer) == CUDA_SUCCESS);
    const auto log = kernel_log();
    REQUIRE(log.size() == 2);
    CHECK(log[1].start_ns == log[0].end_ns);
}

TEST_CASE("Host function runs in stream order when it is launched", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    static std::atomic<int> calls;
    static std::atomic<std::thread::id> thread;
    calls = 0;
    Gate gate;
    gate.hold(stream);
    REQUIRE(cuLaunchHostFunc(
                stream,
                [](void*) {
                    thread = std::this_thread::get_id();
                    calls = 1;
                },
                nullptr) == CUDA_SUCCESS);
    REQUIRE(cuStreamAddCallback(
                stream,
                [](CUstream, CUresult status, void* add) {
                    calls = calls * 10 + *static_cast<int*>(add) + status;
                },
                [] {
                    static int two = 2;
                    return &two;
                }(),
                0) == CUDA_SUCCESS);
    gpu.launch(stream, 1000);
    CHECK(calls == 0);
    gate.open();
    REQUIRE(cuStreamSynchronize(stream) == CUDA_SUCCESS);
    CHECK(calls == 12);
    CHECK(thread.load() != std::this_thread::get_id());
    CHECK(kernel_log().size() == 1);
}

TEST_CASE("Stream goes on when the value that it waits for is written by the host",
          "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    std::uint32_t* gate = nullptr;
    REQUIRE(cuMemHostAlloc(reinterpret_cast<void**>(&gate), 64, CU_MEMHOSTALLOC_DEVICEMAP) ==
            CUDA_SUCCESS);
    CUdeviceptr d_gate = 0;
    REQUIRE(cuMemHostGetDevicePointer(&d_gate, gate, 0) == CUDA_SUCCESS);
    REQUIRE(cuStreamWaitValue32(stream, d_gate, 7, CU_STREAM_WAIT_VALUE_GEQ) == CUDA_SUCCESS);
    REQUIRE(cuStreamWriteValue64(stream, d_gate + 8, 99, 0) == CUDA_SUCCESS);
    gpu.launch(stream, 1000);
    CHECK(cuStreamQuery(stream) == CUDA_ERROR_NOT_READY);
    CHECK(kernel_log().empty());
    __atomic_store_n(gate, 7, __ATOMIC_RELEASE);
    REQUIRE(cuStreamSynchronize(stream) == CUDA_SUCCESS);
    CHECK(reinterpret_cast<std::uint64_t*>(gate)[1] == 99);
    CHECK(kernel_log().size() == 1);
    CHECK(cuStreamWaitValue32(stream, d_gate + 2, 7, 0) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuStreamWriteValue32(stream, 4096, 7, 0) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuStreamWriteValue32(stream, d_gate, 7, CU_STREAM_WRITE_VALUE_NO_MEMORY_BARRIER) ==
          CUDA_ERROR_INVALID_VALUE);
}

TEST_CASE("Work goes on when its stream is destroyed", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    gpu.launch(stream, 1000000);
    gpu.launch(stream, 1000000);
    REQUIRE(cuStreamDestroy(stream) == CUDA_SUCCESS);
    CHECK(cuStreamQuery(stream) == CUDA_ERROR_INVALID_HANDLE);
    REQUIRE(cuCtxSynchronize() == CUDA_SUCCESS);
    CHECK(kernel_log().size() == 2);
}
