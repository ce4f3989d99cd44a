// SPDX-License-Identifier: Apache-2.0
//
// Code that the host and the GPU share: constexpr functions, which nvcc compiles for both
// (--expt-relaxed-constexpr), and loads of atomics in memory that both see. Constants in it are
// numbers: the GPU has no object of the host's to which a function's reference could be bound
// (nvcc says nothing, and the kernel traps).
#pragma once

#include <atomic>
#include <type_traits>

#ifdef __CUDACC__
#define URGENGO_HOST_DEVICE __host__ __device__
#else
#define URGENGO_HOST_DEVICE
#endif

namespace urgengo {

#ifdef __CUDA_ARCH__
inline constexpr bool kOnGpu = true;
#else
inline constexpr bool kOnGpu = false;
#endif

#ifdef __CUDA_ARCH__
/// Of memory that the host may write meanwhile: past the first cache, and never one load for two.
/// Strong loads would be ordered: a round over the bus would take a trip for each of them (62 us
/// with ten tasks, H100) instead of one for all.
template <typename Bits>
__device__ Bits load_past_cache(const void* address) {
    Bits bits;
    if constexpr (sizeof(Bits) == 8)
        asm volatile("ld.global.cg.u64 %0, [%1];" : "=l"(bits) : "l"(address));
    else if constexpr (sizeof(Bits) == 4)
        asm volatile("ld.global.cg.u32 %0, [%1];" : "=r"(bits) : "l"(address));
    else
        asm volatile("ld.global.cg.u16 %0, [%1];" : "=h"(bits) : "l"(address));
    return bits;
}
#endif

/// Acquire on the host. On the GPU each load is whole, and by itself.
/// @threads any, of either side
template <typename T>
URGENGO_HOST_DEVICE T load_shared(const std::atomic<T>& value) {
#ifdef __CUDA_ARCH__
    static_assert(sizeof(std::atomic<T>) == sizeof(T));
    if constexpr (std::is_same_v<T, double>) {
        return __longlong_as_double(
            static_cast<long long>(load_past_cache<unsigned long long>(&value)));
    } else if constexpr (sizeof(T) == 8) {
        return static_cast<T>(load_past_cache<unsigned long long>(&value));
    } else if constexpr (sizeof(T) == 4) {
        return static_cast<T>(load_past_cache<unsigned int>(&value));
    } else if constexpr (sizeof(T) == 2) {
        return static_cast<T>(load_past_cache<unsigned short>(&value));
    } else {
        const auto address = reinterpret_cast<unsigned long long>(&value);
        const auto two =
            load_past_cache<unsigned short>(reinterpret_cast<const void*>(address & ~1ull));
        return static_cast<T>(static_cast<unsigned char>(address % 2 == 0 ? two : two >> 8));
    }
#else
    return value.load(std::memory_order_acquire);
#endif
}

}  // namespace urgengo
