// SPDX-License-Identifier: Apache-2.0
//
// A libcuda.so.1 that does nothing, at once: the baseline of the call benchmark. What a call costs
// with it is the call itself and what UrgenGo adds.
//
// Two things are real, because the scheduler reads them: a mark kernel writes its line as soon as
// it is launched (the GPU is infinitely fast), unless a cuStreamWaitValue32 stands before it in its
// stream: such a stream stands still until it is synchronised. Every call of a thread is counted.
#include <cuda.h>

#include <cstdint>
#include <cstring>
#include <vector>

#include "urgengo/abi/device_mailbox.h"

#define EXPORTED __attribute__((visibility("default")))
// The names as they are exported, not as cuda.h maps them.
#undef cuCtxGetDevice
#undef cuCtxSynchronize
#undef cuDevicePrimaryCtxRelease
#undef cuEventDestroy
#undef cuGetProcAddress
#undef cuMemHostGetDevicePointer
#undef cuMemHostRegister
#undef cuStreamDestroy
#undef cuStreamWaitValue32

namespace {

struct Mark {
    ug_mark_line* line;
    std::uint64_t words[2];

    void execute() const {
        __atomic_store_n(&line->word[0], words[0], __ATOMIC_RELAXED);
        __atomic_store_n(&line->word[1], words[1], __ATOMIC_RELEASE);
    }
};

/// Used by one thread at a time.
struct NullStream {
    bool stands_still = false;
    std::vector<Mark> waiting;
};

char g_context, g_module, g_kernel, g_mark_kernel, g_event;

thread_local std::uint64_t t_calls __attribute__((tls_model("initial-exec"))) = 0;

CUresult counted() {
    ++t_calls;
    return CUDA_SUCCESS;
}

template <typename Handle>
CUresult hand_out(Handle* out, void* object) {
    *out = static_cast<Handle>(object);
    return counted();
}

void launch_mark(NullStream* stream, void** parameters) {
    const auto word0 = *static_cast<std::uint64_t*>(parameters[1]);
    const auto tag = *static_cast<std::uint64_t*>(parameters[2]) & 0xffff;
    const Mark mark{*static_cast<ug_mark_line**>(parameters[0]),
                    {word0, std::uint64_t{1} << 16 | tag}};
    if (stream && stream->stands_still)
        stream->waiting.push_back(mark);
    else
        mark.execute();
}

CUresult launch(CUfunction f, CUstream stream, void** parameters) {
    if (f == reinterpret_cast<CUfunction>(&g_mark_kernel))
        launch_mark(reinterpret_cast<NullStream*>(stream), parameters);
    return counted();
}

}  // namespace

extern "C" {

/// @returns how many calls the calling thread has made
EXPORTED std::uint64_t nulldriver_num_calls() {
    return t_calls;
}

EXPORTED CUresult cuInit(unsigned) {
    return counted();
}
EXPORTED CUresult cuDriverGetVersion(int* version) {
    *version = CUDA_VERSION;
    return counted();
}
EXPORTED CUresult cuDeviceGetCount(int* count) {
    *count = 1;
    return counted();
}
EXPORTED CUresult cuDeviceGet(CUdevice* device, int) {
    *device = 0;
    return counted();
}
EXPORTED CUresult cuDeviceGetName(char* name, int length, CUdevice) {
    std::strncpy(name, "null driver", static_cast<std::size_t>(length));
    return counted();
}
EXPORTED CUresult cuDeviceGetAttribute(int* value, CUdevice_attribute attribute, CUdevice) {
    *value = attribute == CU_DEVICE_ATTRIBUTE_MAX_THREADS_PER_MULTIPROCESSOR ? 2048 : 132;
    return counted();
}
EXPORTED CUresult cuDevicePrimaryCtxRetain(CUcontext* context, CUdevice) {
    return hand_out(context, &g_context);
}
EXPORTED CUresult cuDevicePrimaryCtxRelease_v2(CUdevice) {
    return counted();
}
EXPORTED CUresult cuCtxSetCurrent(CUcontext) {
    return counted();
}
EXPORTED CUresult cuCtxGetCurrent(CUcontext* context) {
    return hand_out(context, &g_context);
}
EXPORTED CUresult cuCtxGetId(CUcontext, unsigned long long* id) {
    *id = 1;
    return counted();
}
EXPORTED CUresult cuCtxGetDevice(CUdevice* device) {
    *device = 0;
    return counted();
}
EXPORTED CUresult cuCtxGetStreamPriorityRange(int* least, int* greatest) {
    *least = 0;
    *greatest = -5;
    return counted();
}
EXPORTED CUresult cuCtxSynchronize() {
    return counted();
}
EXPORTED CUresult cuModuleLoadData(CUmodule* module, const void*) {
    return hand_out(module, &g_module);
}
EXPORTED CUresult cuModuleGetFunction(CUfunction* function, CUmodule, const char* name) {
    const bool is_mark = std::strcmp(name, UG_MARK_KERNEL_NAME) == 0;
    return hand_out(function, is_mark ? &g_mark_kernel : &g_kernel);
}
EXPORTED CUresult cuFuncGetName(const char** name, CUfunction) {
    *name = "bench_kernel";
    return counted();
}
EXPORTED CUresult cuStreamCreate(CUstream* stream, unsigned) {
    return hand_out(stream, new NullStream);
}
EXPORTED CUresult cuStreamDestroy_v2(CUstream stream) {
    delete reinterpret_cast<NullStream*>(stream);
    return counted();
}
EXPORTED CUresult cuStreamIsCapturing(CUstream, CUstreamCaptureStatus* status) {
    *status = CU_STREAM_CAPTURE_STATUS_NONE;
    return counted();
}
EXPORTED CUresult cuStreamWaitValue32_v2(CUstream stream, CUdeviceptr, cuuint32_t, unsigned) {
    reinterpret_cast<NullStream*>(stream)->stands_still = true;
    return counted();
}
EXPORTED CUresult cuStreamSynchronize(CUstream handle) {
    auto* stream = reinterpret_cast<NullStream*>(handle);
    if (stream && stream->stands_still) {
        stream->stands_still = false;
        for (const Mark& mark : stream->waiting) mark.execute();
        stream->waiting.clear();
    }
    return counted();
}
EXPORTED CUresult cuEventCreate(CUevent* event, unsigned) {
    return hand_out(event, &g_event);
}
EXPORTED CUresult cuEventDestroy_v2(CUevent) {
    return counted();
}
EXPORTED CUresult cuEventRecord(CUevent, CUstream) {
    return counted();
}
EXPORTED CUresult cuThreadExchangeStreamCaptureMode(CUstreamCaptureMode*) {
    return counted();
}
EXPORTED CUresult cuMemHostAlloc(void** memory, size_t bytes, unsigned) {
    return hand_out(memory, new char[bytes]());
}
EXPORTED CUresult cuMemHostRegister_v2(void*, size_t, unsigned) {
    return counted();
}
EXPORTED CUresult cuMemHostGetDevicePointer_v2(CUdeviceptr* d_memory, void* memory, unsigned) {
    *d_memory = reinterpret_cast<CUdeviceptr>(memory);
    return counted();
}
EXPORTED CUresult cuLaunchKernel(CUfunction f, unsigned, unsigned, unsigned, unsigned, unsigned,
                                 unsigned, unsigned, CUstream stream, void** parameters, void**) {
    return launch(f, stream, parameters);
}
EXPORTED CUresult cuLaunchKernelEx(const CUlaunchConfig* config, CUfunction f, void** parameters,
                                   void**) {
    return launch(f, config->hStream, parameters);
}

}  // extern "C"
