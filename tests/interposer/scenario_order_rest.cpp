// SPDX-License-Identifier: Apache-2.0
//
// Order of what programs use less: launches of old, values of both sizes and in batches, pools of
// the program's own, managed memory, events of every kind. A word that every kernel multiplies
// before it adds tells which ran, how often and in which order.
#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

/// @returns null if the driver does not have it
template <typename Function>
Function* find(const char* name, int version) {
    void* function = nullptr;
    CUdriverProcAddressQueryResult status;
    const CUresult result = cuGetProcAddress(name, &function, version, 0, &status);
    if (result != CUDA_SUCCESS || !function) say("%s: missing", name);
    return result == CUDA_SUCCESS ? reinterpret_cast<Function*>(function) : nullptr;
}

struct Mixer {
    Gpu gpu;
    CUfunction mix = gpu.function(kMixName);
    std::uint64_t* word = make_mapped(2);

    CUresult launch(std::uint64_t value, CUstream stream) const {
        return launch(on_gpu(word), value, stream);
    }
    CUresult launch(CUdeviceptr to, std::uint64_t value, CUstream stream) const {
        void* parameters[] = {&to, &value};
        return cuLaunchKernel(mix, 1, 1, 1, 1, 1, 1, 0, stream, parameters, nullptr);
    }
    CUresult launch_wide(CUstream stream) const { return twin::launch_wide(gpu.wide, stream); }
};

void CUDA_CB add_seven(void* word) {
    auto& its = *static_cast<std::uint64_t*>(word);
    its = 31 * its + 7;
}

// Launches as they were before cuLaunchKernel.
void old_launches(const Mixer& mixer, CUstream stream) {
    auto* const set_shape = find<CUresult(CUfunction, int, int, int)>("cuFuncSetBlockShape", 2000);
    auto* const set_size = find<CUresult(CUfunction, unsigned)>("cuParamSetSize", 2000);
    auto* const set = find<CUresult(CUfunction, int, void*, unsigned)>("cuParamSetv", 2000);
    auto* const launch = find<CUresult(CUfunction)>("cuLaunch", 2000);
    auto* const launch_grid = find<CUresult(CUfunction, int, int)>("cuLaunchGrid", 2000);
    auto* const launch_async =
        find<CUresult(CUfunction, int, int, CUstream)>("cuLaunchGridAsync", 2000);
    if (!set_shape || !set_size || !set || !launch || !launch_grid || !launch_async) return;
    std::uint64_t parameters[] = {on_gpu(mixer.word), 1};
    *mixer.word = 0;
    SHOW(set_shape(mixer.mix, 1, 1, 1));
    SHOW(set_size(mixer.mix, sizeof parameters));
    SHOW(set(mixer.mix, 0, parameters, sizeof parameters));
    SHOW(mixer.launch_wide(stream));
    SHOW(mixer.launch(2, stream));
    SHOW(launch_async(mixer.mix, 1, 1, stream));
    SHOW(mixer.launch_wide(stream));
    SHOW(launch_async(mixer.mix, 1, 1, stream));
    SHOW(mixer.launch(3, stream));
    // On the legacy stream, for which the stream waits, and the other way about.
    SHOW(launch(mixer.mix));
    SHOW(mixer.launch(4, stream));
    SHOW(launch_grid(mixer.mix, 1, 1));
    SHOW(launch_grid(mixer.mix, 0, 1));
    SHOW(mixer.launch(5, stream));
    SHOW(cuLaunchHostFunc(stream, add_seven, mixer.word));
    SHOW(cuStreamSynchronize(stream));
    SHOW(cuCtxSynchronize());
    say("%llx", static_cast<unsigned long long>(*mixer.word));
}

void cooperative_launches(const Mixer& mixer, CUstream stream) {
    auto* const launch_multi = find<CUresult(CUDA_LAUNCH_PARAMS*, unsigned, unsigned)>(
        "cuLaunchCooperativeKernelMultiDevice", 9000);
    CUdeviceptr to = on_gpu(mixer.word);
    std::uint64_t value = 1;
    void* parameters[] = {&to, &value};
    CUDA_LAUNCH_PARAMS launch{mixer.mix, 1, 1, 1, 1, 1, 1, 0, stream, parameters};
    *mixer.word = 0;
    SHOW(mixer.launch_wide(stream));
    SHOW(mixer.launch(2, stream));
    SHOW(cuLaunchCooperativeKernel(mixer.mix, 1, 1, 1, 1, 1, 1, 0, stream, parameters));
    if (launch_multi) {
        SHOW(launch_multi(&launch, 1, 0));
        SHOW(launch_multi(&launch, 0, 0));
        SHOW(launch_multi(nullptr, 1, 0));
    }
    SHOW(mixer.launch(3, stream));
    SHOW(cuStreamSynchronize(stream));
    say("%llx", static_cast<unsigned long long>(*mixer.word));
}

CUstreamBatchMemOpParams write_of(std::uint64_t* word, std::uint64_t value) {
    CUstreamBatchMemOpParams op{};
    op.writeValue.operation = CU_STREAM_MEM_OP_WRITE_VALUE_64;
    op.writeValue.address = on_gpu(word);
    op.writeValue.value64 = value;
    return op;
}

CUstreamBatchMemOpParams wait_for(std::uint64_t* word, std::uint64_t value) {
    CUstreamBatchMemOpParams op{};
    op.waitValue.operation = CU_STREAM_MEM_OP_WAIT_VALUE_64;
    op.waitValue.address = on_gpu(word);
    op.waitValue.value64 = value;
    op.waitValue.flags = CU_STREAM_WAIT_VALUE_EQ;
    return op;
}

void values(const Mixer& mixer, CUstream stream) {
    std::uint64_t* const flag = make_mapped(2);
    const CUdeviceptr d_word = on_gpu(mixer.word), d_flag = on_gpu(flag);
    *mixer.word = 0;
    SHOW(mixer.launch_wide(stream));
    SHOW(mixer.launch(1, stream));
    SHOW(cuStreamWriteValue64(stream, d_word, 0x200000003, CU_STREAM_WRITE_VALUE_DEFAULT));
    SHOW(mixer.launch(4, stream));
    SHOW(cuStreamWriteValue32(stream, d_flag, 5, CU_STREAM_WRITE_VALUE_DEFAULT));
    SHOW(cuStreamWaitValue32(stream, d_flag, 4, CU_STREAM_WAIT_VALUE_GEQ));
    SHOW(cuStreamWaitValue64(stream, d_flag, 1, CU_STREAM_WAIT_VALUE_AND));
    SHOW(mixer.launch_wide(stream));
    CUstreamBatchMemOpParams ops[] = {write_of(flag + 1, 8), wait_for(flag + 1, 8),
                                      write_of(mixer.word, 9)};
    SHOW(cuStreamBatchMemOp(stream, 3, ops, 0));
    SHOW(cuStreamBatchMemOp(stream, 3, nullptr, 0));
    SHOW(mixer.launch(6, stream));
    SHOW(cuLaunchHostFunc(stream, add_seven, mixer.word));
    SHOW(cuStreamSynchronize(stream));
    say("%llx %d %d", static_cast<unsigned long long>(*mixer.word), int(flag[0]), int(flag[1]));
}

void pools(const Mixer& mixer, CUstream stream) {
    CUmemPoolProps properties{};
    properties.allocType = CU_MEM_ALLOCATION_TYPE_PINNED;
    properties.location = {CU_MEM_LOCATION_TYPE_DEVICE, {0}};
    CUmemoryPool pool = nullptr;
    SHOW(cuMemPoolCreate(&pool, &properties));
    for (int i = 0; i < 3; ++i) {
        CUdeviceptr memory = 0, other = 0;
        SHOW(mixer.launch_wide(stream));
        SHOW(cuMemAllocFromPoolAsync(&memory, 64, pool, stream));
        SHOW(cuMemAllocAsync(&other, 64, stream));
        SHOW(cuMemsetD8Async(memory, 0, 64, stream));
        SHOW(mixer.launch(memory, 11, stream));
        SHOW(cuMemcpyAsync(other, memory, 8, stream));
        SHOW(mixer.launch(other, 12, stream));
        SHOW(cuMemFreeAsync(memory, stream));
        SHOW(cuMemcpyAsync(on_gpu(mixer.word), other, 8, stream));
        SHOW(cuMemFreeAsync(other, stream));
        SHOW(mixer.launch(13, stream));
    }
    SHOW(cuStreamSynchronize(stream));
    SHOW(cuMemPoolTrimTo(pool, 0));
    SHOW(cuMemPoolDestroy(pool));
    say("%llx", static_cast<unsigned long long>(*mixer.word));
}

void managed(const Mixer& mixer, CUstream stream) {
    auto* const prefetch =
        find<CUresult(CUdeviceptr, std::size_t, CUdevice, CUstream)>("cuMemPrefetchAsync", 8000);
    auto* const attach = find<CUresult(CUstream, CUdeviceptr, std::size_t, unsigned)>(
        "cuStreamAttachMemAsync", 6000);
    CUdeviceptr memory = 0;
    SHOW(cuMemAllocManaged(&memory, 4096, CU_MEM_ATTACH_GLOBAL));
    auto* const word = reinterpret_cast<std::uint64_t*>(memory);
    *word = 0;
    SHOW(mixer.launch_wide(stream));
    SHOW(mixer.launch(memory, 1, stream));
    if (prefetch) SHOW(prefetch(memory, 4096, 0, stream));
    SHOW(mixer.launch(memory, 2, stream));
    if (prefetch) SHOW(prefetch(memory, 4096, CU_DEVICE_CPU, stream));
    if (attach) SHOW(attach(stream, memory, 0, CU_MEM_ATTACH_GLOBAL));
    SHOW(mixer.launch(memory, 3, stream));
    SHOW(cuStreamSynchronize(stream));
    say("%llx", static_cast<unsigned long long>(*word));
    SHOW(cuMemFree(memory));
}

void events(const Mixer& mixer, CUstream stream) {
    const CUstream other = make_stream();
    CUevent begin = nullptr, end = nullptr, untimed = nullptr;
    SHOW(cuEventCreate(&begin, CU_EVENT_DEFAULT));
    SHOW(cuEventCreate(&end, CU_EVENT_BLOCKING_SYNC));
    SHOW(cuEventCreate(&untimed, CU_EVENT_DISABLE_TIMING));
    *mixer.word = 0;
    SHOW(cuEventRecord(begin, stream));
    SHOW(mixer.launch_wide(stream));
    SHOW(mixer.launch(1, stream));
    SHOW(cuEventRecordWithFlags(end, stream, CU_EVENT_RECORD_DEFAULT));
    SHOW(cuStreamWaitEvent(other, end, CU_EVENT_WAIT_DEFAULT));
    SHOW(mixer.launch(2, other));
    SHOW(cuEventRecord(untimed, other));
    SHOW(cuStreamWaitEvent(stream, untimed, CU_EVENT_WAIT_DEFAULT));
    SHOW(mixer.launch(3, stream));
    SHOW(cuEventSynchronize(end));
    SHOW(cuEventQuery(end));
    float milliseconds = -1;
    SHOW(cuEventElapsedTime(&milliseconds, begin, end));
    say("time passed: %d", milliseconds > 0);
    SHOW(cuEventElapsedTime(&milliseconds, begin, untimed));
    SHOW(cuEventSynchronize(untimed));
    SHOW(cuStreamSynchronize(stream));
    // Recorded again: an old wait is for the old record.
    SHOW(cuEventRecord(untimed, stream));
    SHOW(cuStreamSynchronize(stream));
    SHOW(cuEventQuery(untimed));
    say("%llx", static_cast<unsigned long long>(*mixer.word));
    for (CUevent event : {begin, end, untimed}) SHOW(cuEventDestroy(event));
    SHOW(cuStreamDestroy(other));
}

// None to use: what the calls answer.
void semaphores(CUstream stream) {
    using Signal = CUresult(const CUexternalSemaphore*,
                            const CUDA_EXTERNAL_SEMAPHORE_SIGNAL_PARAMS*, unsigned, CUstream);
    using Wait = CUresult(const CUexternalSemaphore*, const CUDA_EXTERNAL_SEMAPHORE_WAIT_PARAMS*,
                          unsigned, CUstream);
    if (auto* const signal = find<Signal>("cuSignalExternalSemaphoresAsync", 10000))
        SHOW(signal(nullptr, nullptr, 0, stream));
    if (auto* const wait = find<Wait>("cuWaitExternalSemaphoresAsync", 10000))
        SHOW(wait(nullptr, nullptr, 0, stream));
}

int order_rest(const Arguments&) {
    const Mixer mixer;
    const std::pair<const char*, CUstream> streams[] = {
        {"legacy", nullptr},
        {"per-thread", CU_STREAM_PER_THREAD},
        {"blocking", make_stream(CU_STREAM_DEFAULT)},
        {"non-blocking", make_stream(CU_STREAM_NON_BLOCKING, -1)}};
    for (const auto& [name, stream] : streams) {
        say("%s stream", name);
        // Unordered with the legacy stream's, the launches of old would race here.
        if (stream != streams[3].second) old_launches(mixer, stream);
        cooperative_launches(mixer, stream);
        values(mixer, stream);
        pools(mixer, stream);
        managed(mixer, stream);
        events(mixer, stream);
        semaphores(stream);
    }
    return 0;
}

// Some call of it kills the program with driver 580.159.04, bare; which one is not known yet.
const Scenario s1("order_rest", order_rest, Runs::kSimulated);

}  // namespace
}  // namespace twin
