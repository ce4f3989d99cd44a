// SPDX-License-Identifier: Apache-2.0
//
// A machine with a second GPU: what the program sees of it, work on both at once and in turn, and
// the priority at which the second one's kernels ran: the program's own.
#include <atomic>
#include <thread>
#include <vector>

#include "tests/interposer/gpu.h"
#include "tests/interposer/kernel_log.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

/// What Gpu is for the first device.
struct SecondGpu {
    SecondGpu() {
        MUST(cuDevicePrimaryCtxRetain(&context, 1));
        MUST(cuCtxPushCurrent(context));
        MUST(cuModuleLoadData(&module, kImage));
        MUST(cuModuleGetFunction(&store, module, kStoreName));
        MUST(cuModuleGetFunction(&wide, module, "wide"));
        MUST(cuModuleGetFunction(&second, module, "second"));
        MUST(cuCtxPopCurrent(nullptr));
    }
    ~SecondGpu() { cuDevicePrimaryCtxRelease(1); }
    SecondGpu(const SecondGpu&) = delete;
    SecondGpu& operator=(const SecondGpu&) = delete;

    CUcontext context = nullptr;
    CUmodule module = nullptr;
    CUfunction store = nullptr, wide = nullptr, second = nullptr;
};

void look_around() {
    int count = 0;
    SHOW(cuDeviceGetCount(&count));
    for (int ordinal = 0; ordinal <= count; ++ordinal) {
        CUdevice device = -1;
        char name[64] = "", bus[32] = "";
        int num_sms = 0;
        std::size_t bytes = 0;
        SHOW(cuDeviceGet(&device, ordinal));
        SHOW(cuDeviceGetName(name, sizeof name, ordinal));
        SHOW(cuDeviceGetPCIBusId(bus, sizeof bus, ordinal));
        SHOW(cuDeviceGetAttribute(&num_sms, CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT, ordinal));
        SHOW(cuDeviceTotalMem(&bytes, ordinal));
        say("%d: '%s' at %s, %d SMs, %zu", device, name, bus, num_sms, bytes);
    }
}

/// What the current context says of itself.
void say_where() {
    const auto get =
        reinterpret_cast<CUresult (*)(CUdevice*)>(entry_point("cuCtxGetDevice", 2000, 0));
    CUdevice device = -1;
    CUdeviceptr memory = 0;
    int ordinal = -1;
    SHOW(get(&device));
    SHOW(cuMemAlloc(&memory, 256));
    SHOW(cuPointerGetAttribute(&ordinal, CU_POINTER_ATTRIBUTE_DEVICE_ORDINAL, memory));
    SHOW(cuMemFree(memory));
    say("device %d, memory on %d", device, ordinal);
}

/// Frames on the second device, of kernels named "second", on streams of several priorities.
std::uint64_t run_frames(const SecondGpu& gpu, int num_frames) {
    MUST(cuCtxSetCurrent(gpu.context));
    std::uint64_t* to = make_mapped(2);
    std::uint64_t sum = 0;
    for (int frame = 0; frame < num_frames; ++frame) {
        const CUstream stream = make_stream(CU_STREAM_NON_BLOCKING, -(frame % 3));
        for (int i = 0; i < 4; ++i) sum += launch_wide(gpu.wide, stream);
        sum += launch_tiny(gpu.second, stream);
        sum += launch_store(gpu.store, to, std::uint64_t(frame), stream);
        sum += cuStreamSynchronize(stream);
        sum += to[0];
        sum += cuStreamDestroy(stream);
    }
    return sum;
}

// Across devices by an event, both ways.
void ping_pong(const Gpu& first, const SecondGpu& second) {
    std::uint64_t* word = make_mapped(2);
    const CUstream here = make_stream();
    CUevent there_done = nullptr, here_done = nullptr;
    SHOW(cuEventCreate(&here_done, CU_EVENT_DISABLE_TIMING));
    MUST(cuCtxPushCurrent(second.context));
    const CUstream there = make_stream();
    SHOW(cuEventCreate(&there_done, CU_EVENT_DISABLE_TIMING));
    MUST(cuCtxPopCurrent(nullptr));
    for (std::uint64_t i = 0; i < 4; ++i) {
        SHOW(launch_wide(first.wide, here));
        SHOW(launch_store(first.store, word, 10 + i, here));
        SHOW(cuEventRecord(here_done, here));
        SHOW(cuStreamWaitEvent(there, here_done, 0));
        MUST(cuCtxPushCurrent(second.context));
        SHOW(launch_wide(second.wide, there));
        SHOW(launch_store(second.store, word, 20 + i, there));
        SHOW(cuEventRecord(there_done, there));
        MUST(cuCtxPopCurrent(nullptr));
        SHOW(cuStreamWaitEvent(here, there_done, 0));
        SHOW(cuStreamSynchronize(i % 2 == 0 ? here : there));
        say("%d", int(word[0]));
    }
    SHOW(launch_tiny(second.second, here));  // the wrong device's
    SHOW(cuEventRecord(there_done, here));
}

void say_second_kernels() {
    for (const simgpu_kernel_record& kernel : kernel_log("second"))
        say("%s ran on %u at %d", kernel.name, kernel.device, kernel.priority);
    std::size_t num_marks = 0;
    for (const simgpu_kernel_record& kernel : kernel_log(kStoreName))
        num_marks += kernel.device == 1 ? 1 : 0;
    say("stores on the second device: %zu", num_marks);
}

int devices(const Arguments&) {
    const Gpu first;
    look_around();
    const SecondGpu second;
    say_where();
    MUST(cuCtxPushCurrent(second.context));
    say_where();
    MUST(cuCtxPopCurrent(nullptr));
    // The first device is the one that is scheduled: some work there.
    const CUstream own = make_stream();
    const CUfunction very_long = first.function("very_long");
    for (int i = 0; i < 3; ++i) SHOW(launch_wide(very_long, own));
    // One thread for each device, and the main thread's work under way.
    std::vector<std::uint64_t> sums(2);
    std::thread on_first([&] {
        name_this_thread("twin_3");
        MUST(cuCtxSetCurrent(first.context));
        const CUstream stream = make_stream();
        for (int i = 0; i < 20; ++i) sums[0] += launch_wide(first.wide, stream);
        sums[0] += cuStreamSynchronize(stream);
    });
    std::thread on_second([&] {
        name_this_thread("twin_6");
        sums[1] = run_frames(second, 6);
    });
    on_first.join();
    on_second.join();
    SHOW(cuStreamSynchronize(own));
    for (const std::uint64_t sum : sums) say("%llu", static_cast<unsigned long long>(sum));
    ping_pong(first, second);
    // The main thread itself moves over, and back.
    say("%llu", static_cast<unsigned long long>(run_frames(second, 3)));
    SHOW(cuCtxSetCurrent(first.context));
    SHOW(launch_wide(first.wide, own));
    SHOW(cuCtxSynchronize());
    say_second_kernels();
    return 0;
}

const Scenario s1("devices", devices, Runs::kSimulated);

}  // namespace
}  // namespace twin
