// SPDX-License-Identifier: Apache-2.0
//
// Order of values of both sizes and in batches, pools of the program's own, managed memory.
#include "tests/interposer/mixer.h"

namespace twin {
namespace {

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

int values(const Arguments&) {
    return on_every_stream([](const Mixer& mixer, CUstream stream) {
        std::uint64_t* const flag = make_mapped(1);
        const CUdeviceptr d_word = on_gpu(mixer.word), d_flag = on_gpu(flag);
        STEP(mixer.launch_wide(stream));
        STEP(mixer.launch(1, stream));
        STEP(cuStreamWriteValue64(stream, d_word, 0x200000003, CU_STREAM_WRITE_VALUE_DEFAULT));
        STEP(mixer.launch(4, stream));
        STEP(cuStreamWriteValue32(stream, d_flag, 5, CU_STREAM_WRITE_VALUE_DEFAULT));
        STEP(cuStreamWaitValue32(stream, d_flag, 4, CU_STREAM_WAIT_VALUE_GEQ));
        STEP(cuStreamWaitValue64(stream, d_flag, 1, CU_STREAM_WAIT_VALUE_AND));
        STEP(mixer.launch_wide(stream));
        STEP(mixer.launch(6, stream));
        STEP(cuLaunchHostFunc(stream, add_seven, mixer.word));
        STEP(cuStreamSynchronize(stream));
        say("%d", int(*flag));
    });
}

int batched_values(const Arguments&) {
    return on_every_stream([](const Mixer& mixer, CUstream stream) {
        std::uint64_t* const flag = make_mapped(1);
        STEP(mixer.launch_wide(stream));
        STEP(mixer.launch(1, stream));
        CUstreamBatchMemOpParams ops[] = {write_of(flag, 8), wait_for(flag, 8),
                                          write_of(mixer.word, 9)};
        STEP(cuStreamBatchMemOp(stream, 3, ops, 0));
        STEP(mixer.launch(6, stream));
        STEP(cuStreamSynchronize(stream));
        say("%d", int(*flag));
    });
}

// A batch from nowhere.
int batched_values_none(const Arguments&) {
    return on_every_stream([](const Mixer& mixer, CUstream stream) {
        STEP(mixer.launch_wide(stream));
        STEP(mixer.launch(1, stream));
        STEP(cuStreamBatchMemOp(stream, 3, nullptr, 0));
        STEP(mixer.launch(2, stream));
        STEP(cuStreamSynchronize(stream));
    });
}

int pools(const Arguments&) {
    return on_every_stream([](const Mixer& mixer, CUstream stream) {
        CUmemPoolProps properties{};
        properties.allocType = CU_MEM_ALLOCATION_TYPE_PINNED;
        properties.location = {CU_MEM_LOCATION_TYPE_DEVICE, {0}};
        CUmemoryPool pool = nullptr;
        STEP(cuMemPoolCreate(&pool, &properties));
        for (int i = 0; i < 3; ++i) {
            CUdeviceptr memory = 0, other = 0;
            STEP(mixer.launch_wide(stream));
            STEP(cuMemAllocFromPoolAsync(&memory, 64, pool, stream));
            STEP(cuMemAllocAsync(&other, 64, stream));
            STEP(cuMemsetD8Async(memory, 0, 64, stream));
            STEP(mixer.launch(memory, 11, stream));
            STEP(cuMemcpyAsync(other, memory, 8, stream));
            STEP(mixer.launch(other, 12, stream));
            STEP(cuMemFreeAsync(memory, stream));
            STEP(cuMemcpyAsync(on_gpu(mixer.word), other, 8, stream));
            STEP(cuMemFreeAsync(other, stream));
            STEP(mixer.launch(13, stream));
        }
        STEP(cuStreamSynchronize(stream));
        STEP(cuMemPoolTrimTo(pool, 0));
        STEP(cuMemPoolDestroy(pool));
    });
}

int managed(const Arguments&) {
    using Prefetch = CUresult(CUdeviceptr, std::size_t, CUdevice, CUstream);
    using Attach = CUresult(CUstream, CUdeviceptr, std::size_t, unsigned);
    return on_every_stream([](const Mixer& mixer, CUstream stream) {
        auto* const prefetch = find<Prefetch>("cuMemPrefetchAsync", 8000);
        auto* const attach = find<Attach>("cuStreamAttachMemAsync", 6000);
        CUdeviceptr memory = 0;
        MUST(cuMemAllocManaged(&memory, 4096, CU_MEM_ATTACH_GLOBAL));
        auto* const word = reinterpret_cast<std::uint64_t*>(memory);
        *word = 0;
        STEP(mixer.launch_wide(stream));
        STEP(mixer.launch(memory, 1, stream));
        if (prefetch) STEP(prefetch(memory, 4096, 0, stream));
        STEP(mixer.launch(memory, 2, stream));
        if (prefetch) STEP(prefetch(memory, 4096, CU_DEVICE_CPU, stream));
        if (attach) STEP(attach(stream, memory, 0, CU_MEM_ATTACH_GLOBAL));
        STEP(mixer.launch(memory, 3, stream));
        STEP(cuStreamSynchronize(stream));
        say("%llx", static_cast<unsigned long long>(*word));
        STEP(cuMemFree(memory));
    });
}

const Scenario s1("order_values", values), s2("order_batched_values", batched_values),
    s3("order_batched_values_none", batched_values_none), s4("order_pools", pools),
    s5("order_managed", managed);

}  // namespace
}  // namespace twin
