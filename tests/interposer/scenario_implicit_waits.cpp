// SPDX-License-Identifier: Apache-2.0
//
// Calls that wait for all work of the context on their way: each behind a launch.
#include <unistd.h>
#include <urgengo/urgengo.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <functional>
#include <iterator>
#include <string>
#include <thread>
#include <vector>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

// cuCtxDetach: old, and still there.
#pragma GCC diagnostic ignored "-Wdeprecated-declarations"

namespace twin {
namespace {

constexpr std::size_t kBytes = 4096;

/// A call of the program's, on what was made for it.
using Call = std::function<CUresult()>;

Call free_memory(const Gpu&) {
    CUdeviceptr memory = 0;
    MUST(cuMemAlloc(&memory, kBytes));
    return [=] { return cuMemFree(memory); };
}

Call free_host(const Gpu&) {
    void* memory = nullptr;
    MUST(cuMemAllocHost(&memory, kBytes));
    return [=] { return cuMemFreeHost(memory); };
}

Call unregister(const Gpu&) {
    alignas(kBytes) static char memory[kBytes];
    MUST(cuMemHostRegister(memory, kBytes, 0));
    return [] { return cuMemHostUnregister(memory); };
}

Call unmap(const Gpu&) {
    CUmemAllocationProp properties{};
    properties.type = CU_MEM_ALLOCATION_TYPE_PINNED;
    properties.location = {CU_MEM_LOCATION_TYPE_DEVICE, {0}};
    std::size_t bytes = 0;
    CUdeviceptr address = 0;
    CUmemGenericAllocationHandle memory = 0;
    MUST(cuMemGetAllocationGranularity(&bytes, &properties, CU_MEM_ALLOC_GRANULARITY_MINIMUM));
    MUST(cuMemAddressReserve(&address, bytes, 0, 0, 0));
    MUST(cuMemCreate(&memory, bytes, &properties, 0));
    MUST(cuMemMap(address, bytes, 0, memory, 0));
    MUST(cuMemRelease(memory));
    return [=] { return cuMemUnmap(address, bytes); };
}

Call destroy_array(const Gpu&) {
    CUDA_ARRAY_DESCRIPTOR shape{};
    shape.Width = 16, shape.NumChannels = 1, shape.Format = CU_AD_FORMAT_FLOAT;
    CUarray array = nullptr;
    MUST(cuArrayCreate(&array, &shape));
    return [=] { return cuArrayDestroy(array); };
}

Call destroy_mipmapped(const Gpu&) {
    CUDA_ARRAY3D_DESCRIPTOR shape{};
    shape.Width = shape.Height = 16, shape.NumChannels = 1, shape.Format = CU_AD_FORMAT_FLOAT;
    CUmipmappedArray array = nullptr;
    MUST(cuMipmappedArrayCreate(&array, &shape, 3));
    return [=] { return cuMipmappedArrayDestroy(array); };
}

Call set_limit(const Gpu&) {
    std::size_t bytes = 0;
    MUST(cuCtxGetLimit(&bytes, CU_LIMIT_PRINTF_FIFO_SIZE));
    return [=] { return cuCtxSetLimit(CU_LIMIT_PRINTF_FIFO_SIZE, 2 * bytes); };
}

Call unload_module(const Gpu&) {
    CUmodule module = nullptr;
    MUST(cuModuleLoadData(&module, kImage));
    return [=] { return cuModuleUnload(module); };
}

const std::pair<const char*, Call (*)(const Gpu&)> kCalls[] = {
    {"cuMemFree", free_memory},          {"cuMemFreeHost", free_host},
    {"cuMemHostUnregister", unregister}, {"cuMemUnmap", unmap},
    {"cuArrayDestroy", destroy_array},   {"cuMipmappedArrayDestroy", destroy_mipmapped},
    {"cuCtxSetLimit", set_limit},        {"cuModuleUnload", unload_module}};

// Each waits, where it does, for the program's own launch, while a less urgent thread goes on
// launching.
int implicit_waits(const Arguments&) {
    const Gpu gpu;
    const CUstream stream = make_stream();
    std::uint64_t* const word = make_mapped(2);
    std::atomic<bool> stop{false};
    std::thread other([&] {
        name_this_thread("twin_0");
        MUST(cuCtxSetCurrent(gpu.context));
        const CUstream its = make_stream();
        std::uint64_t* const count = make_mapped(2);
        std::uint64_t num = 0;
        while (!stop) {
            MUST(launch_store(gpu.store, count, ++num, its));
            MUST(cuStreamSynchronize(its));
        }
        say("the other's launches ran: %d", *count == num);
    });
    for (const auto& [name, prepare] : kCalls) {
        const Call call = prepare(gpu);
        *word = 0;
        MUST(launch_wide(gpu.wide, stream));
        MUST(launch_store(gpu.store, word, 17, stream));
        show(name, call);
        // What a real driver waits for, only its authors know.
        if (simulated()) say("waited: %d", *word == 17);
        MUST(cuStreamSynchronize(stream));
        say("%d", int(*word));
    }
    stop = true;
    other.join();
    SHOW(cuMemUnmap(0, kBytes));
    SHOW(cuMipmappedArrayDestroy(nullptr));
    return 0;
}

// One of them.
int waits_for_all_work(const Arguments& arguments) {
    const Gpu gpu;
    const CUstream stream = make_stream();
    for (const auto& [name, prepare] : kCalls) {
        if (arguments.empty() || arguments.front() != name) continue;
        const Call call = prepare(gpu);
        MUST(launch_wide(gpu.wide, stream));
        MUST(call());
        MUST(cuStreamSynchronize(stream));
        say("done");
    }
    return 0;
}

Call synchronize(const Gpu&) {
    return [] { return cuCtxSynchronize(); };
}

Call synchronize_from_another(const Gpu& gpu) {
    const CUcontext another = make_context();
    MUST(cuCtxSetCurrent(gpu.context));
    return [&gpu, another] {
        MUST(cuCtxSetCurrent(another));
        const CUresult result = cuCtxSynchronize_v2(gpu.context);
        MUST(cuCtxSetCurrent(gpu.context));
        return result;
    };
}

Call launch_first(const Gpu& gpu) {
    return [&gpu, stream = make_stream()] { return launch_tiny(gpu.tiny, stream); };
}

Call load_module(const Gpu&) {
    return [] {
        CUmodule module = nullptr;
        return cuModuleLoadData(&module, kImage);
    };
}

Call load_with_options(const Gpu&) {
    return [] {
        CUmodule module = nullptr;
        return cuModuleLoadDataEx(&module, kImage, 0, nullptr, nullptr);
    };
}

Call load_fat_binary(const Gpu&) {
    return [] {
        CUmodule module = nullptr;
        return cuModuleLoadFatBinary(&module, kImage);
    };
}

Call load_file(const Gpu&) {
    char path[] = "/tmp/twin_image_XXXXXX";
    const int file = mkstemp(path);
    const ssize_t length = sizeof(kImage) - 1;
    if (file < 0 || write(file, kImage, sizeof(kImage) - 1) != length) std::exit(2);
    close(file);
    return [name = std::string(path)] {
        CUmodule module = nullptr;
        const CUresult result = cuModuleLoad(&module, name.c_str());
        unlink(name.c_str());
        return result;
    };
}

/// Loads the kernel, as no launch has.
Call get_function(const Gpu&) {
    CUlibrary library = nullptr;
    CUkernel kernel = nullptr;
    MUST(cuLibraryLoadData(&library, kImage, nullptr, nullptr, 0, nullptr, nullptr, 0));
    MUST(cuLibraryGetKernel(&kernel, library, "tiny"));
    return [kernel] {
        CUfunction function = nullptr;
        return cuKernelGetFunction(&function, kernel);
    };
}

Call unload_library(const Gpu&) {
    CUlibrary library = nullptr;
    MUST(cuLibraryLoadData(&library, kImage, nullptr, nullptr, 0, nullptr, nullptr, 0));
    return [library] { return cuLibraryUnload(library); };
}

Call destroy_context(const Gpu& gpu) {
    const CUcontext another = make_context();
    MUST(cuCtxSetCurrent(gpu.context));
    return [another] { return cuCtxDestroy(another); };
}

Call detach_context(const Gpu& gpu) {
    const CUcontext another = make_context();
    MUST(cuCtxSetCurrent(gpu.context));
    return [&gpu, another] {
        MUST(cuCtxSetCurrent(another));
        const CUresult result = cuCtxDetach(another);
        MUST(cuCtxSetCurrent(gpu.context));
        return result;
    };
}

/// It stays: the frames' work is in it.
Call release_context(const Gpu&) {
    CUcontext same = nullptr;
    MUST(cuDevicePrimaryCtxRetain(&same, 0));
    return [] { return cuDevicePrimaryCtxRelease(0); };
}

Call destroy_green(const Gpu&) {
    CUdevResource all{};
    CUdevResourceDesc description = nullptr;
    CUgreenCtx green = nullptr;
    MUST(cuDeviceGetDevResource(0, &all, CU_DEV_RESOURCE_TYPE_SM));
    MUST(cuDevResourceGenerateDesc(&description, &all, 1));
    MUST(cuGreenCtxCreate(&green, description, 0, CU_GREEN_CTX_DEFAULT_STREAM));
    return [green] { return cuGreenCtxDestroy(green); };
}

/// A thread's launch of a frame of the chain, until its end.
class Frame {
  public:
    Frame(const Gpu& gpu, const ug_hints& hints, const char* chain, CUfunction kernel)
        : thread_([&gpu, &hints, chain, kernel, this] {
              MUST(cuCtxSetCurrent(gpu.context));
              const CUstream stream = make_stream();
              hints.task_begin(hints.arrival(chain, 0, UG_CLOCK_MONOTONIC), "work");
              MUST(launch_wide(kernel, stream));
              launched_ = true;
              MUST(cuStreamSynchronize(stream));
              hints.task_end();
          }) {
        while (!launched_) std::this_thread::yield();
    }
    ~Frame() { thread_.join(); }

  private:
    std::atomic<bool> launched_{false};
    std::thread thread_;
};

// A thread of no chain makes such calls while a launch of `loose` waits for a kernel of `tight`, if
// anything makes it wait.
int bystander_waits(const Arguments&) {
    constexpr char kImageOfIt[] =
        R"({"kernels": [{"name": "slow", "block_ns": 200000000, "blocks_per_sm": 2}]})";
    ug_hints hints;
    ug_hints_load(&hints);
    const Gpu gpu;
    CUmodule module = nullptr;
    CUfunction slow = nullptr;
    MUST(cuModuleLoadData(&module, kImageOfIt));
    MUST(cuModuleGetFunction(&slow, module, "slow"));
    const CUstream stream = make_stream();
    for (int i = 0; i < 3; ++i) MUST(launch_wide(gpu.wide, stream));
    MUST(cuStreamSynchronize(stream));
    std::vector<std::pair<const char*, Call (*)(const Gpu&)>> calls{
        {"none", nullptr},  // loads the kernels
        {"cuCtxSynchronize", synchronize},
        {"cuCtxSynchronize_v2", synchronize_from_another},
        {"cuModuleLoadData", load_module},
        {"cuModuleLoadDataEx", load_with_options},
        {"cuModuleLoadFatBinary", load_fat_binary},
        {"cuModuleLoad", load_file},
        {"cuKernelGetFunction", get_function},
        {"a first launch", launch_first}};
    calls.insert(calls.end(), std::begin(kCalls), std::end(kCalls));
    // After each of these, and after cuModuleUnload, all kernels are new.
    const std::pair<const char*, Call (*)(const Gpu&)> ends[] = {
        {"cuLibraryUnload", unload_library},
        {"cuCtxDestroy", destroy_context},
        {"cuCtxDetach", detach_context},
        {"cuDevicePrimaryCtxRelease", release_context},
        {"cuGreenCtxDestroy", destroy_green}};
    const std::size_t first_end = calls.size();
    calls.insert(calls.end(), std::begin(ends), std::end(ends));
    auto next = std::chrono::steady_clock::now();
    for (std::size_t i = 0; i < calls.size(); ++i) {
        const auto& [name, prepare] = calls[i];
        // Not before a frame is due: what has that much time shares the GPU.
        std::this_thread::sleep_until(next);
        next = std::max(next, std::chrono::steady_clock::now()) + std::chrono::milliseconds(300);
        const Call call = prepare ? prepare(gpu) : Call([] { return CUDA_SUCCESS; });
        if (i >= first_end) {
            MUST(launch_wide(slow, stream));
            MUST(launch_wide(gpu.wide, stream));
            MUST(cuStreamSynchronize(stream));
        }
        const Frame tight(gpu, hints, "tight", slow), loose(gpu, hints, "loose", gpu.wide);
        show(name, call);
    }
    return 0;
}

const Scenario s1("implicit_waits", implicit_waits), s2("waits_for_all_work", waits_for_all_work),
    s3("bystander_waits", bystander_waits, Runs::kSimulated);

}  // namespace
}  // namespace twin
