// SPDX-License-Identifier: Apache-2.0
//
// What an image made by nvcc says of its kernels: their names, where their parameters are, and what
// they take. Reads cubins (ELF: .nv.info and .nv.info.<kernel>), PTX text, and fat binaries of
// both as long as they are not compressed; instructions are never looked at.
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

namespace urgengo::simgpu {

struct KernelImage {
    std::vector<std::size_t> param_offsets;  ///< in the buffer that a launch passes
    std::vector<std::size_t> param_bytes;
    int num_regs = 0;     ///< 0: not said
    int max_threads = 0;  ///< 0: not said
    std::size_t shared_bytes = 0;
};

class Image {
  public:
    /// @param[in] data  the image; its own headers say where it ends, as for the driver
    static Image parse(const void* data);

    /// @returns null if the image does not say anything of that kernel
    const KernelImage* find(const std::string& kernel) const;

    /// Whether the kernels found are all that there are: else it is of another kind, or compressed.
    bool is_complete() const { return understood_ && !compressed_; }

    /// Whether part of it is compressed, and so unknown.
    bool is_compressed() const { return compressed_; }

  private:
    friend class ImageReader;
    bool understood_ = false;
    bool compressed_ = false;
    std::map<std::string, KernelImage> kernels_;
};

}  // namespace urgengo::simgpu
