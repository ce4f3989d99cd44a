// SPDX-License-Identifier: Apache-2.0
//
// What all random programs of a process use: memory, streams, kernels.
#pragma once

#include <array>
#include <cstdint>
#include <type_traits>

#include "tests/interposer/gpu.h"
#include "tests/interposer/random_program.h"
#include "tests/interposer/twin.h"

namespace twin {

inline constexpr std::size_t kMostFlags = 256;
inline constexpr std::size_t kWordBytes = 2 * sizeof(std::uint64_t);

struct Machine {
    Gpu gpu;
    CUfunction mix = gpu.function(kMixName), long_ = gpu.function("long");
    std::array<CUstream, kFirstPerThreadStream> streams{nullptr,
                                                        make_stream(CU_STREAM_DEFAULT),
                                                        make_stream(CU_STREAM_DEFAULT, -1),
                                                        make_stream(),
                                                        make_stream(CU_STREAM_NON_BLOCKING, -5),
                                                        make_stream(CU_STREAM_NON_BLOCKING, -2)};
    std::array<CUstream, kMaxThreads> capturing{make_stream(), make_stream(), make_stream()};
    std::uint64_t* h_words = make_mapped(2 * kNumHostWords);
    std::uint64_t* flags = make_mapped(kMostFlags);
    CUdeviceptr d_words = 0;

    // The entries of the per-thread flavour.
    decltype(&cuLaunchKernel) launch_ptsz;
    decltype(&cuMemcpyAsync) copy_ptsz;
    decltype(&cuMemcpyDtoH) copy_to_host_ptds;
    decltype(&cuStreamSynchronize) synchronize_ptsz;

    Machine() {
        MUST(cuMemAlloc(&d_words, kWordBytes * (kNumWords - kNumHostWords)));
        const auto find = [](auto& function, const char* name) {
            function = reinterpret_cast<std::remove_reference_t<decltype(function)>>(
                entry_point(name, 7000, CU_GET_PROC_ADDRESS_PER_THREAD_DEFAULT_STREAM));
        };
        find(launch_ptsz, "cuLaunchKernel");
        find(copy_ptsz, "cuMemcpyAsync");
        find(copy_to_host_ptds, "cuMemcpyDtoH");
        find(synchronize_ptsz, "cuStreamSynchronize");
        // Loaded now: a driver that loads at the first launch may wait for the GPU.
        MUST(launch_tiny(gpu.tiny, nullptr));
        MUST(launch_wide(gpu.wide, nullptr));
        MUST(launch_wide(long_, nullptr));
        MUST(launch_store(gpu.store, h_words, 0, nullptr));
        CUdeviceptr word = on_gpu(h_words);
        std::uint64_t value = 0;
        void* parameters[] = {&word, &value};
        MUST(cuLaunchKernel(mix, 1, 1, 1, 1, 1, 1, 0, nullptr, parameters, nullptr));
        MUST(cuCtxSynchronize());
    }

    CUdeviceptr word(int index) const {
        const auto i = static_cast<std::size_t>(index);
        return index < kNumHostWords ? on_gpu(h_words + 2 * i)
                                     : d_words + kWordBytes * (i - kNumHostWords);
    }
};

}  // namespace twin
