// SPDX-License-Identifier: Apache-2.0
//
// The workload's two kernels: fixed arithmetic, and streaming reads. Their first parameter is the
// amount of work per thread, so that calibration can scale it; each block adds one value to its
// stream's results. Launched with 256 threads a block, loaded through the driver API.
#include "tools/chains/stream_results.h"

using urgengo::chains::StreamResults;

namespace {

// No thread's value ever equals this, but the compiler cannot know: it must compute all of them.
constexpr float kNever = -123.456f;

/// Blocks of this stream that have ended, as seen by thread 0 when its block begins.
__device__ unsigned blocks_done_at_start(const StreamResults* results) {
    return threadIdx.x == 0 ? *(const volatile unsigned*)&results->blocks_done : 0;
}

/// @param value          this thread's result; thread 0's stands for the block
/// @param blocks_before  blocks of all earlier launches on this stream, modulo 2^32
__device__ void finish_block(StreamResults* results, unsigned blocks_before, unsigned blocks_seen,
                             float value) {
    if (threadIdx.x == 0) {
        // In stream order, all earlier launches have ended and at most our siblings since.
        if (blocks_seen - blocks_before >= gridDim.x) atomicAdd(&results->blocks_misordered, 1u);
        atomicAdd(&results->sum, (unsigned long long)__float_as_uint(value));
        atomicAdd(&results->blocks_done, 1u);
    } else if (value == kNever) {
        results->sum = 0;
    }
}

}  // namespace

/// Four independent chains of fused multiply-adds per thread: issue-bound at any occupancy.
extern "C" __global__ void chains_comp(int iterations, StreamResults* results,
                                       unsigned blocks_before) {
    const unsigned seen = blocks_done_at_start(results);
    const float factor = 1.000001f;
    float a = threadIdx.x * 1e-3f, b = a + 1, c = a + 2, d = a + 3;
    for (int i = 0; i < iterations; i++) {
        a = __fmaf_rn(a, factor, 1e-7f);
        b = __fmaf_rn(b, factor, 1e-7f);
        c = __fmaf_rn(c, factor, 1e-7f);
        d = __fmaf_rn(d, factor, 1e-7f);
    }
    finish_block(results, blocks_before, seen, a + b + c + d);
}

/// Coalesced 16-byte reads that stride through an input larger than the cache.
/// @param input       16-byte aligned, filled with 1.0f
/// @param index_mask  number of float4 in input, a power of two, less one
extern "C" __global__ void chains_mem(int iterations, StreamResults* results,
                                      unsigned blocks_before, const float4* __restrict__ input,
                                      unsigned index_mask) {
    const unsigned seen = blocks_done_at_start(results);
    const unsigned stride = gridDim.x * blockDim.x;
    unsigned index = blockIdx.x * blockDim.x + threadIdx.x;
    float4 sum = {0, 0, 0, 0};
    for (int i = 0; i < iterations; i++, index += stride) {
        const float4 value = input[index & index_mask];
        sum.x += value.x;
        sum.y += value.y;
        sum.z += value.z;
        sum.w += value.w;
    }
    finish_block(results, blocks_before, seen, sum.x + sum.y + sum.z + sum.w);
}
