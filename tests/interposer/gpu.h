// SPDX-License-Identifier: Apache-2.0
//
// What most scenarios start with: a context, a module, memory. One kernel computes (store), so that
// results prove that launches ran, and in which order; the others only take their time.
#pragma once

#include <cuda.h>

#include <cstddef>
#include <cstdint>
#include <string>

#include "tests/interposer/kernels.h"

namespace twin {

/// The primary context, current, and a module. Released when it goes.
class Gpu {
  public:
    Gpu();
    ~Gpu();
    Gpu(const Gpu&) = delete;
    Gpu& operator=(const Gpu&) = delete;

    /// Any name is a kernel of the simulated GPU; a real one has those of kernels.h.
    CUfunction function(const char* name) const;

    CUcontext context = nullptr;
    CUmodule module = nullptr;
    CUfunction store;  ///< see launch_store()
    CUfunction tiny;   ///< takes 10 us
    CUfunction wide;   ///< takes 300 us and fills the GPU if launched by launch_wide()
};

/// A created context, current. (cuda.h's cuCtxCreate has another signature in CUDA 13.)
CUcontext make_context();

CUstream make_stream(unsigned flags = CU_STREAM_NON_BLOCKING, int priority = 0);

/// Host memory that the GPU sees at the same address, zeroed; freed with the context.
std::uint64_t* make_mapped(std::size_t num_words);
inline CUdeviceptr on_gpu(const void* mapped) {
    return reinterpret_cast<CUdeviceptr>(mapped);
}

/// A launch that writes `value` to to[0], and a tag (its low 16 bits) and a time to to[1].
CUresult launch_store(CUfunction store, std::uint64_t* to, std::uint64_t value, CUstream stream);
CUresult launch_tiny(CUfunction tiny, CUstream stream);
CUresult launch_wide(CUfunction wide, CUstream stream);

/// Names the calling thread, as the tests' config matches it.
void name_this_thread(const std::string& name);

/// The entry point that cuGetProcAddress answers.
void* entry_point(const char* name, int version, cuuint64_t flags);

}  // namespace twin
