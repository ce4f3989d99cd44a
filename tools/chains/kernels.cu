// SPDX-License-Identifier: Apache-2.0
//
// The workload's two kernels: fixed arithmetic, and streaming reads. Their first parameter is the
// amount of work per thread, so that calibration can scale it; each block adds one value to its
// stream's results. Launched with 256 threads a block, loaded through the driver API.
//
// A launch asked for stamps (stream_results.h) tells when it began and ended. It waits for its
// blocks' count to come back, which one without stamps does not.
#include "tools/chains/clock_mailbox.h"
#include "tools/chains/stream_results.h"

using urgengo::chains::ClockMailbox;
using urgengo::chains::StreamResults;

namespace {

// No thread's value ever equals this, but the compiler cannot know: it must compute all of them.
constexpr float kNever = -123.456f;

__device__ unsigned long long globaltimer_ns() {
    unsigned long long ns;
    asm volatile("mov.u64 %0, %globaltimer;" : "=l"(ns));
    return ns;
}

__device__ bool wants_stamps(unsigned long long results) {
    return results & urgengo::chains::kWithStamps;
}

__device__ StreamResults* results_at(unsigned long long results) {
    return reinterpret_cast<StreamResults*>(results & ~urgengo::chains::kWithStamps);
}

/// What thread 0 sees when its block begins.
struct Begin {
    unsigned blocks_done = 0;  ///< of this stream
    unsigned long long ns = 0;
};

__device__ Begin begin_block(unsigned long long results) {
    Begin begin;
    if (threadIdx.x != 0) return begin;
    if (wants_stamps(results)) begin.ns = globaltimer_ns();
    begin.blocks_done = *(const volatile unsigned*)&results_at(results)->blocks_done;
    return begin;
}

/// By thread 0 of a block whose threads have all computed. The launch is counted when all its
/// blocks are done, so they all find the same index.
__device__ void stamp_block(StreamResults* results, unsigned blocks_before, const Begin& begin) {
    auto& stamps = results->stamps;
    const unsigned index = *(const volatile unsigned*)&stamps.launches;
    const bool has_room = index < stamps.room;
    // The first block to begin has seen none of its siblings end.
    if (has_room && begin.blocks_done == blocks_before)
        atomicMin(&stamps.stamps[index].begin_ns, begin.ns);
    const unsigned done = atomicAdd(&results->blocks_done, 1u) + 1;
    if (done != blocks_before + gridDim.x) return;
    if (has_room) stamps.stamps[index].end_ns = globaltimer_ns();
    stamps.launches = index + 1;
}

/// @param value          this thread's result; thread 0's stands for the block
/// @param blocks_before  blocks of all earlier launches on this stream, modulo 2^32
__device__ void finish_block(unsigned long long results_word, unsigned blocks_before,
                             const Begin& begin, float value) {
    StreamResults* const results = results_at(results_word);
    if (wants_stamps(results_word)) __syncthreads();
    if (threadIdx.x == 0) {
        // In stream order, all earlier launches have ended and at most our siblings since.
        if (begin.blocks_done - blocks_before >= gridDim.x)
            atomicAdd(&results->blocks_misordered, 1u);
        atomicAdd(&results->sum, (unsigned long long)__float_as_uint(value));
        if (wants_stamps(results_word)) {
            stamp_block(results, blocks_before, begin);
        } else {
            atomicAdd(&results->blocks_done, 1u);
        }
    } else if (value == kNever) {
        results->sum = 0;
    }
}

}  // namespace

/// Four independent chains of fused multiply-adds per thread: issue-bound at any occupancy.
extern "C" __global__ void chains_comp(int iterations, unsigned long long results,
                                       unsigned blocks_before) {
    const Begin begin = begin_block(results);
    const float factor = 1.000001f;
    float a = threadIdx.x * 1e-3f, b = a + 1, c = a + 2, d = a + 3;
    for (int i = 0; i < iterations; i++) {
        a = __fmaf_rn(a, factor, 1e-7f);
        b = __fmaf_rn(b, factor, 1e-7f);
        c = __fmaf_rn(c, factor, 1e-7f);
        d = __fmaf_rn(d, factor, 1e-7f);
    }
    finish_block(results, blocks_before, begin, a + b + c + d);
}

/// Coalesced 16-byte reads that stride through an input larger than the cache.
/// @param input       16-byte aligned, filled with 1.0f
/// @param index_mask  number of float4 in input, a power of two, less one
extern "C" __global__ void chains_mem(int iterations, unsigned long long results,
                                      unsigned blocks_before, const float4* __restrict__ input,
                                      unsigned index_mask) {
    const Begin begin = begin_block(results);
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
    finish_block(results, blocks_before, begin, sum.x + sum.y + sum.z + sum.w);
}

/// Answers the host's requests with the time, one thread, until told to stop.
extern "C" __global__ void chains_clock(volatile ClockMailbox* mailbox) {
    const unsigned long long begin_ns = globaltimer_ns();
    unsigned answered = 0;
    while (globaltimer_ns() - begin_ns < urgengo::chains::kClockPatienceNs) {
        const unsigned asked = mailbox->asked;
        if (asked == urgengo::chains::kClockStop) break;
        if (asked == answered) continue;
        mailbox->time_ns = globaltimer_ns();
        __threadfence_system();
        mailbox->answered = answered = asked;
    }
}
