// SPDX-License-Identifier: Apache-2.0
//
// The streaming multiprocessors as room for blocks. A block of a kernel that fits n times on an SM
// takes 1/n of one; a block never straddles two SMs. Blocks go where most room is, as on hardware.
// Not thread-safe: the engine owns it.
#pragma once

#include <cstdint>
#include <vector>

namespace urgengo::simgpu {

class SmArray {
  public:
    static constexpr int kMaxBlocksPerSm = 16;

    /// So many blocks of one kernel on one SM.
    struct Share {
        int sm;
        std::uint32_t num_blocks;
    };
    using Placement = std::vector<Share>;

    explicit SmArray(int num_sms);

    /// Takes room for as many of `num_blocks` as there is.
    /// @param[in] blocks_per_sm  1 to kMaxBlocksPerSm: how many fit on an empty SM
    /// @returns where they went; empty if there is no room
    Placement place(std::uint64_t num_blocks, int blocks_per_sm);

    void release(const Placement& placement, int blocks_per_sm);

  private:
    std::vector<std::uint32_t> free_;  ///< per SM, in kUnits
};

}  // namespace urgengo::simgpu
