// SPDX-License-Identifier: Apache-2.0
//
// Calls that wait for all work of the context on their way: each behind a launch.
#include <atomic>
#include <functional>
#include <thread>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

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

const Scenario s1("implicit_waits", implicit_waits), s2("waits_for_all_work", waits_for_all_work);

}  // namespace
}  // namespace twin
