// SPDX-License-Identifier: Apache-2.0
//
// Stream memory operations of the simulated driver: every comparison, batches, and waits that
// another stream's write ends.
#include "tests/unit/test_simgpu_support.h"

namespace {

struct Words {
    Words() {
        REQUIRE(cuMemHostAlloc(reinterpret_cast<void**>(&host), 64, 0) == CUDA_SUCCESS);
        device = reinterpret_cast<CUdeviceptr>(host);
    }
    std::uint64_t* host = nullptr;
    CUdeviceptr device = 0;
};

/// The value that is there, the one waited for, and whether that ends the wait.
struct Comparison {
    unsigned flags;
    std::uint64_t found;
    std::uint64_t value;
    bool open;
};

}  // namespace

TEST_CASE("Wait is over when the comparison holds", "[unit][simgpu]") {
    const SimGpu gpu;
    const Words words;
    const CUstream stream = gpu.stream();
    const auto comparison =
        GENERATE(Comparison{CU_STREAM_WAIT_VALUE_GEQ, 5, 5, true},
                 Comparison{CU_STREAM_WAIT_VALUE_GEQ, 4, 5, false},
                 // Cyclic: what is half the range ahead counts as behind.
                 Comparison{CU_STREAM_WAIT_VALUE_GEQ, 1, 0xffffffffffffffff, true},
                 Comparison{CU_STREAM_WAIT_VALUE_EQ, 6, 5, false},
                 Comparison{CU_STREAM_WAIT_VALUE_EQ, 5, 5, true},
                 Comparison{CU_STREAM_WAIT_VALUE_AND, 6, 4, true},
                 Comparison{CU_STREAM_WAIT_VALUE_AND, 3, 4, false},
                 Comparison{CU_STREAM_WAIT_VALUE_NOR, 0xfffffffffffffff0, 0xf, false},
                 Comparison{CU_STREAM_WAIT_VALUE_NOR, 0xfffffffffffffff0, 0x7, true});
    const bool wide = GENERATE(false, true);
    *words.host = wide ? comparison.found : static_cast<std::uint32_t>(comparison.found);
    if (wide) {
        REQUIRE(cuStreamWaitValue64(stream, words.device, comparison.value, comparison.flags) ==
                CUDA_SUCCESS);
    } else {
        REQUIRE(cuStreamWaitValue32(stream, words.device,
                                    static_cast<std::uint32_t>(comparison.value),
                                    comparison.flags) == CUDA_SUCCESS);
    }
    gpu.launch(stream, 1000);
    if (!comparison.open) {
        // Another stream runs through meanwhile.
        const CUstream other = gpu.stream();
        gpu.launch(other, 100000);
        REQUIRE(cuStreamSynchronize(other) == CUDA_SUCCESS);
        CHECK(cuStreamQuery(stream) == CUDA_ERROR_NOT_READY);
        __atomic_store_n(words.host,
                         comparison.flags == CU_STREAM_WAIT_VALUE_NOR ? 0 : comparison.value,
                         __ATOMIC_RELEASE);
    }
    CHECK(cuStreamSynchronize(stream) == CUDA_SUCCESS);
}

TEST_CASE("Wait is over when another stream writes the value", "[unit][simgpu]") {
    const SimGpu gpu;
    const Words words;
    const CUstream waiting = gpu.stream();
    const CUstream writing = gpu.stream();
    Gate gate;
    REQUIRE(cuStreamWaitValue64(waiting, words.device, uint64_t{1} << 40,
                                CU_STREAM_WAIT_VALUE_EQ) == CUDA_SUCCESS);
    gpu.launch(waiting, 1000);
    gate.hold(writing);
    gpu.launch(writing, 1000000);
    REQUIRE(cuStreamWriteValue64(writing, words.device, uint64_t{1} << 40, 0) == CUDA_SUCCESS);
    CHECK(cuStreamQuery(waiting) == CUDA_ERROR_NOT_READY);
    gate.open();
    REQUIRE(cuStreamSynchronize(waiting) == CUDA_SUCCESS);
    const auto log = kernel_log();
    REQUIRE(log.size() == 2);
    CHECK(log[1].start_ns == log[0].end_ns + 2000);  // what a write takes
}

TEST_CASE("Batch of memory operations runs in order when it is submitted", "[unit][simgpu]") {
    const SimGpu gpu;
    const Words words;
    const CUstream stream = gpu.stream();
    CUstreamBatchMemOpParams ops[4]{};
    ops[0].operation = CU_STREAM_MEM_OP_WRITE_VALUE_32;
    ops[0].writeValue.address = words.device;
    ops[0].writeValue.value = 3;
    ops[1].operation = CU_STREAM_MEM_OP_WAIT_VALUE_64;
    ops[1].waitValue.address = words.device + 8;
    ops[1].waitValue.value64 = 7;
    ops[1].waitValue.flags = CU_STREAM_WAIT_VALUE_GEQ;
    ops[2].operation = CU_STREAM_MEM_OP_BARRIER;
    ops[3].operation = CU_STREAM_MEM_OP_WRITE_VALUE_64;
    ops[3].writeValue.address = words.device + 16;
    ops[3].writeValue.value64 = 11;
    REQUIRE(cuStreamBatchMemOp(stream, 4, ops, 0) == CUDA_SUCCESS);
    for (int i = 0; i < 5000 && __atomic_load_n(words.host, __ATOMIC_ACQUIRE) != 3; ++i) {
        const CUstream other = gpu.stream();
        gpu.launch(other, 10000);
        REQUIRE(cuStreamSynchronize(other) == CUDA_SUCCESS);
    }
    CHECK(words.host[0] == 3);
    CHECK(words.host[2] == 0);
    CHECK(cuStreamQuery(stream) == CUDA_ERROR_NOT_READY);
    __atomic_store_n(words.host + 1, 8, __ATOMIC_RELEASE);
    REQUIRE(cuStreamSynchronize(stream) == CUDA_SUCCESS);
    CHECK(words.host[2] == 11);
}
