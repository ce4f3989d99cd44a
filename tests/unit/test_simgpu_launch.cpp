// SPDX-License-Identifier: Apache-2.0
//
// Launches, modules, functions and native kernels of the simulated driver.
#include <array>
#include <thread>

#include "tests/unit/test_simgpu_support.h"

TEST_CASE("Kernel takes what the module's cost table says when it is launched", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    REQUIRE(gpu.launch(stream, 300000, 47) == CUDA_SUCCESS);  // 46 SMs: two waves
    REQUIRE(cuStreamSynchronize(stream) == CUDA_SUCCESS);
    const auto log = kernel_log();
    REQUIRE(log.size() == 1);
    CHECK(std::string(log[0].name) == "unit");
    CHECK(log[0].stream_id == id_of(stream));
    CHECK(log[0].num_blocks == 47);
    CHECK(log[0].end_ns - log[0].start_ns == 600000);
}

TEST_CASE("Kernels of a stream run one after the other when they queue", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    Gate gate;
    gate.hold(stream);
    for (int i = 0; i < 10; ++i) gpu.launch(stream, 100000);
    gate.open();
    REQUIRE(cuStreamSynchronize(stream) == CUDA_SUCCESS);
    const auto log = kernel_log();
    REQUIRE(log.size() == 10);
    // All of them queued, so each starts exactly one launch overhead after the last.
    for (std::size_t i = 1; i < log.size(); ++i) {
        CHECK(log[i].start_ns - log[i - 1].end_ns == 2000);
        CHECK(log[i].end_ns - log[i].start_ns == 100000);
    }
}

TEST_CASE("Launch attribute overrides the stream's priority when it is given", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream low = gpu.stream(CU_STREAM_NON_BLOCKING, 0);
    const CUstream high = gpu.stream(CU_STREAM_NON_BLOCKING, -3);
    Gate gate;
    const CUstream gated = gpu.stream();
    CUevent opened = nullptr;
    REQUIRE(cuEventCreate(&opened, CU_EVENT_DISABLE_TIMING) == CUDA_SUCCESS);
    gate.hold(gated);
    cuEventRecord(opened, gated);
    cuStreamWaitEvent(high, opened, 0);  // both become ready at one moment
    cuStreamWaitEvent(low, opened, 0);
    unsigned ns = 1000;
    void* params[] = {&ns};
    CUlaunchAttribute attribute{};
    attribute.id = CU_LAUNCH_ATTRIBUTE_PRIORITY;
    attribute.value.priority = -100;  // clamped
    CUlaunchConfig config{46, 1, 1, 32, 1, 1, 0, low, &attribute, 1};
    REQUIRE(gpu.launch(high, 1000, 46) == CUDA_SUCCESS);
    REQUIRE(cuLaunchKernelEx(&config, gpu.function("unit"), params, nullptr) == CUDA_SUCCESS);
    gate.open();
    REQUIRE(cuCtxSynchronize() == CUDA_SUCCESS);
    const auto log = kernel_log();
    REQUIRE(log.size() == 2);
    CHECK(log[0].stream_id == id_of(low));
    CHECK(log[0].priority == -5);
    CHECK(log[1].priority == -3);
    CHECK(log[1].start_ns == log[0].end_ns);
}

TEST_CASE("Launch is refused when its shape is impossible", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUfunction f = gpu.function("short");
    const auto launch = [f](unsigned gx, unsigned gy, unsigned bx, unsigned by, unsigned bz,
                            unsigned shared) {
        return cuLaunchKernel(f, gx, gy, 1, bx, by, bz, shared, nullptr, nullptr, nullptr);
    };
    CHECK(launch(0, 1, 32, 1, 1, 0) == CUDA_ERROR_INVALID_VALUE);
    CHECK(launch(1, 1, 0, 1, 1, 0) == CUDA_ERROR_INVALID_VALUE);
    CHECK(launch(1, 1, 1025, 1, 1, 0) == CUDA_ERROR_INVALID_VALUE);
    CHECK(launch(1, 1, 64, 32, 1, 0) == CUDA_ERROR_INVALID_VALUE);
    CHECK(launch(1, 1, 1, 1, 65, 0) == CUDA_ERROR_INVALID_VALUE);
    CHECK(launch(1, 65536, 32, 1, 1, 0) == CUDA_ERROR_INVALID_VALUE);
    CHECK(launch(1, 1, 32, 1, 1, 48 * 1024 + 1) == CUDA_ERROR_INVALID_VALUE);
    REQUIRE(cuFuncSetAttribute(f, CU_FUNC_ATTRIBUTE_MAX_DYNAMIC_SHARED_SIZE_BYTES, 64 * 1024) ==
            CUDA_SUCCESS);
    CHECK(launch(1, 1, 32, 1, 1, 48 * 1024 + 1) == CUDA_SUCCESS);
    CHECK(launch(1, 1, 1024, 1, 1, 0) == CUDA_SUCCESS);
}

TEST_CASE("Launch is refused when a handle is not alive", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUfunction f = gpu.function("short");
    const CUstream stream = gpu.stream();
    REQUIRE(cuStreamDestroy(stream) == CUDA_SUCCESS);
    CHECK(cuLaunchKernel(f, 1, 1, 1, 32, 1, 1, 0, stream, nullptr, nullptr) ==
          CUDA_ERROR_INVALID_HANDLE);
    CHECK(cuLaunchKernel(nullptr, 1, 1, 1, 32, 1, 1, 0, nullptr, nullptr, nullptr) ==
          CUDA_ERROR_INVALID_HANDLE);
    REQUIRE(cuModuleUnload(gpu.module) == CUDA_SUCCESS);
    CHECK(cuLaunchKernel(f, 1, 1, 1, 32, 1, 1, 0, nullptr, nullptr, nullptr) ==
          CUDA_ERROR_INVALID_HANDLE);
}

TEST_CASE("Cost follows a parameter when it comes in a buffer", "[unit][simgpu]") {
    const SimGpu gpu;
    struct {
        std::uint32_t first;
        std::uint64_t units;
    } buffer{5, 70000};
    std::size_t bytes = sizeof buffer;
    void* extra[] = {CU_LAUNCH_PARAM_BUFFER_POINTER, &buffer, CU_LAUNCH_PARAM_BUFFER_SIZE, &bytes,
                     CU_LAUNCH_PARAM_END};
    REQUIRE(cuLaunchKernel(gpu.function("second"), 1, 1, 1, 32, 1, 1, 0, nullptr, nullptr, extra) ==
            CUDA_SUCCESS);
    REQUIRE(cuCtxSynchronize() == CUDA_SUCCESS);
    REQUIRE(kernel_log().size() == 1);
    CHECK(kernel_log()[0].end_ns - kernel_log()[0].start_ns == 70000);
    CHECK(cuLaunchKernel(gpu.function("second"), 1, 1, 1, 32, 1, 1, 0, nullptr, nullptr, nullptr) ==
          CUDA_ERROR_INVALID_VALUE);
    void* params[] = {&buffer.first, &buffer.units};
    CHECK(cuLaunchKernel(gpu.function("second"), 1, 1, 1, 32, 1, 1, 0, nullptr, params, extra) ==
          CUDA_ERROR_INVALID_VALUE);
}

TEST_CASE("Cooperative launch is refused when not all blocks fit at once", "[unit][simgpu]") {
    const SimGpu gpu;
    unsigned ns = 1000;
    void* params[] = {&ns};
    const CUfunction f = gpu.function("unit");
    CHECK(cuLaunchCooperativeKernel(f, 46, 1, 1, 32, 1, 1, 0, nullptr, params) == CUDA_SUCCESS);
    CHECK(cuLaunchCooperativeKernel(f, 47, 1, 1, 32, 1, 1, 0, nullptr, params) ==
          CUDA_ERROR_COOPERATIVE_LAUNCH_TOO_LARGE);
}

TEST_CASE("Delay takes as long as it is told to", "[unit][simgpu]") {
    const SimGpu gpu;
    std::uint64_t ns = 4321;
    void* params[] = {&ns};
    REQUIRE(cuLaunchKernel(gpu.function("urgengo_delay"), 1, 1, 1, 1, 1, 1, 0, nullptr, params,
                           nullptr) == CUDA_SUCCESS);
    REQUIRE(cuStreamSynchronize(nullptr) == CUDA_SUCCESS);
    const auto log = kernel_log();
    REQUIRE(log.size() == 1);
    CHECK(log[0].end_ns - log[0].start_ns == 4321);
}

TEST_CASE("Mark writes its line at its end when it is launched in either form", "[unit][simgpu]") {
    const SimGpu gpu;
    CUmodule marks = nullptr;
    REQUIRE(cuModuleLoadData(&marks,
                             "\x7f"
                             "ELF, or whatever") == CUDA_SUCCESS);
    CUfunction mark = nullptr;
    REQUIRE(cuModuleGetFunction(&mark, marks, "urgengo_mark") == CUDA_SUCCESS);
    std::uint64_t* line = nullptr;
    REQUIRE(cuMemAllocHost(reinterpret_cast<void**>(&line), 128) == CUDA_SUCCESS);
    struct {
        CUdeviceptr line;
        std::uint64_t word0;
        std::uint64_t tag;
    } values{reinterpret_cast<CUdeviceptr>(line), 0xabcdef, 0x12345};

    void* params[] = {&values.line, &values.word0, &values.tag};
    std::size_t bytes = sizeof values;
    void* extra[] = {CU_LAUNCH_PARAM_BUFFER_POINTER, &values, CU_LAUNCH_PARAM_BUFFER_SIZE, &bytes,
                     CU_LAUNCH_PARAM_END};
    const bool in_buffer = GENERATE(false, true);
    Gate gate;
    gate.hold(nullptr);
    REQUIRE(cuLaunchKernel(mark, 1, 1, 1, 1, 1, 1, 0, nullptr, in_buffer ? nullptr : params,
                           in_buffer ? extra : nullptr) == CUDA_SUCCESS);
    values = {0, 0, 0};  // taken at the launch
    CHECK(cuStreamQuery(nullptr) == CUDA_ERROR_NOT_READY);
    CHECK(line[1] == 0);
    gate.open();
    REQUIRE(cuStreamSynchronize(nullptr) == CUDA_SUCCESS);

    const auto log = kernel_log();
    REQUIRE(log.size() == 1);
    CHECK(log[0].end_ns - log[0].start_ns == 1500);
    const auto globaltimer_ns =
        static_cast<std::uint64_t>(log[0].end_ns + SIMGPU_GLOBALTIMER_OFFSET_NS);
    CHECK(line[0] == 0xabcdef);
    CHECK(line[1] == ((globaltimer_ns << 16) | 0x2345));

    bytes = 16;
    values.line = reinterpret_cast<CUdeviceptr>(line);
    CHECK(cuLaunchKernel(mark, 1, 1, 1, 1, 1, 1, 0, nullptr, nullptr, extra) ==
          CUDA_ERROR_INVALID_VALUE);
}

TEST_CASE("Module is refused when its cost table is wrong", "[unit][simgpu]") {
    const SimGpu gpu;
    CUmodule module = nullptr;
    CHECK(cuModuleLoadData(&module, "\n {\"kernels\": 3}") == CUDA_ERROR_INVALID_IMAGE);
    CHECK(cuModuleLoadData(&module, nullptr) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuModuleLoad(&module, "/nonexistent/module.cubin") == CUDA_ERROR_FILE_NOT_FOUND);
}

TEST_CASE("Function keeps its handle and name when it is asked for again", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUfunction f = gpu.function("anything");
    CHECK(gpu.function("anything") == f);
    CHECK(gpu.function("other") != f);
    const char* name = nullptr;
    CHECK(cuFuncGetName(&name, f) == CUDA_SUCCESS);
    CHECK(std::string(name) == "anything");
    CUmodule module = nullptr;
    CHECK(cuFuncGetModule(&module, f) == CUDA_SUCCESS);
    CHECK(module == gpu.module);
}

TEST_CASE("Kernel runs when it is passed as a function", "[unit][simgpu]") {
    const SimGpu gpu;
    CUlibrary library = nullptr;
    REQUIRE(cuLibraryLoadData(&library, R"({"kernels":[{"name":"k","block_ns":1234}]})", nullptr,
                              nullptr, 0, nullptr, nullptr, 0) == CUDA_SUCCESS);
    CUkernel kernel = nullptr;
    REQUIRE(cuLibraryGetKernel(&kernel, library, "k") == CUDA_SUCCESS);
    CUfunction f = nullptr;
    REQUIRE(cuKernelGetFunction(&f, kernel) == CUDA_SUCCESS);
    for (CUfunction either : {f, reinterpret_cast<CUfunction>(kernel)}) {
        REQUIRE(cuLaunchKernel(either, 1, 1, 1, 32, 1, 1, 0, nullptr, nullptr, nullptr) ==
                CUDA_SUCCESS);
    }
    REQUIRE(cuCtxSynchronize() == CUDA_SUCCESS);
    REQUIRE(kernel_log().size() == 2);
    CHECK(kernel_log()[1].end_ns - kernel_log()[1].start_ns == 1234);
    CHECK(cuLibraryUnload(library) == CUDA_SUCCESS);
    CHECK(cuLaunchKernel(f, 1, 1, 1, 32, 1, 1, 0, nullptr, nullptr, nullptr) ==
          CUDA_ERROR_INVALID_HANDLE);
}

TEST_CASE("Occupancy follows the table or the threads when asked", "[unit][simgpu]") {
    const SimGpu gpu;
    int blocks = 0;
    CHECK(cuOccupancyMaxActiveBlocksPerMultiprocessor(&blocks, gpu.function("unit"), 64, 0) ==
          CUDA_SUCCESS);
    CHECK(blocks == 1);
    const CUfunction f = gpu.function("short");
    CHECK(cuOccupancyMaxActiveBlocksPerMultiprocessor(&blocks, f, 64, 0) == CUDA_SUCCESS);
    CHECK(blocks == 16);
    CHECK(cuOccupancyMaxActiveBlocksPerMultiprocessor(&blocks, f, 512, 0) == CUDA_SUCCESS);
    CHECK(blocks == 3);
}

TEST_CASE("Launches from many threads all complete when they share the GPU", "[unit][simgpu]") {
    const SimGpu gpu;
    constexpr int kThreads = 8;
    constexpr int kLaunches = 200;
    std::array<CUresult, kThreads> results{};
    std::vector<std::thread> threads;
    const CUfunction f = gpu.function("short");
    for (int i = 0; i < kThreads; ++i) {
        threads.emplace_back([&, i] {
            cuCtxSetCurrent(gpu.context);
            CUstream stream = nullptr;
            cuStreamCreateWithPriority(&stream, i % 2, -i);
            CUresult result = CUDA_SUCCESS;
            for (int n = 0; n < kLaunches && result == CUDA_SUCCESS; ++n) {
                result = cuLaunchKernel(f, 4, 1, 1, 64, 1, 1, 0, n % 16 == 0 ? nullptr : stream,
                                        nullptr, nullptr);
                if (n % 10 == 0) cuStreamSynchronize(stream);
            }
            results[static_cast<std::size_t>(i)] = result;
            cuStreamDestroy(stream);
        });
    }
    for (auto& thread : threads) thread.join();
    CHECK(cuCtxSynchronize() == CUDA_SUCCESS);
    for (CUresult result : results) CHECK(result == CUDA_SUCCESS);
    CHECK(kernel_log().size() == kThreads * kLaunches);
}
