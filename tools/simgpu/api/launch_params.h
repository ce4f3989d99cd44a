// SPDX-License-Identifier: Apache-2.0
//
// The parameters that a launch passes.
#pragma once

#include "tools/simgpu/api/entry_names.h"

#include <cuda.h>

#include <cstddef>
#include <cstring>

namespace urgengo::simgpu {

/// A launch's parameters in either form: an array of pointers, or one buffer.
class LaunchParams {
  public:
    static CUresult read(void** pointers, void** extra, LaunchParams& params) {
        if (pointers != nullptr && extra != nullptr) return CUDA_ERROR_INVALID_VALUE;
        params.pointers_ = pointers;
        if (extra == nullptr) return CUDA_SUCCESS;
        for (void** entry = extra; *entry != CU_LAUNCH_PARAM_END; entry += 2) {
            if (*entry == CU_LAUNCH_PARAM_BUFFER_POINTER) {
                params.buffer_ = static_cast<const std::byte*>(entry[1]);
            } else if (*entry == CU_LAUNCH_PARAM_BUFFER_SIZE) {
                params.buffer_bytes_ = *static_cast<const std::size_t*>(entry[1]);
            } else {
                return CUDA_ERROR_INVALID_VALUE;
            }
        }
        return CUDA_SUCCESS;
    }

    /// Copies the parameter of `bytes` that is number `index`, at `offset` in the buffer form.
    /// @returns false if the launch does not pass it
    bool copy(std::size_t index, std::size_t offset, std::size_t bytes, void* to) const {
        if (pointers_ != nullptr && pointers_[index] != nullptr) {
            std::memcpy(to, pointers_[index], bytes);
            return true;
        }
        if (buffer_ == nullptr || offset + bytes > buffer_bytes_) return false;
        std::memcpy(to, buffer_ + offset, bytes);
        return true;
    }

  private:
    void** pointers_ = nullptr;
    const std::byte* buffer_ = nullptr;
    std::size_t buffer_bytes_ = 0;
};

}  // namespace urgengo::simgpu
