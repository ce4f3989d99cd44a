// SPDX-License-Identifier: Apache-2.0
//
// Room is counted in units of 1/720720 of an SM: divisible by every number up to 16, so shares are
// exact and an SM filled by a mix of kernels is neither over- nor underfilled by rounding.
#include "tools/simgpu/engine/sm_array.h"

#include <algorithm>
#include <utility>

namespace urgengo::simgpu {
namespace {

constexpr std::uint32_t kUnits = 720720;

constexpr bool divides_all() {
    for (std::uint32_t n = 1; n <= SmArray::kMaxBlocksPerSm; ++n) {
        if (kUnits % n != 0) return false;
    }
    return true;
}
static_assert(divides_all());

std::uint32_t unit_of(int blocks_per_sm) {
    return kUnits / static_cast<std::uint32_t>(blocks_per_sm);
}

}  // namespace

SmArray::SmArray(int num_sms) : free_(static_cast<std::size_t>(num_sms), kUnits) {}

SmArray::Placement SmArray::place(std::uint64_t num_blocks, int blocks_per_sm) {
    const std::uint32_t unit = unit_of(blocks_per_sm);
    std::uint64_t room = 0;
    for (std::uint32_t units : free_) room += units / unit;
    num_blocks = std::min(num_blocks, room);

    std::vector<std::uint32_t> left = free_;
    while (num_blocks > 0) {
        // One block to every SM that is within a block of the emptiest, then again.
        const std::uint32_t most = *std::max_element(left.begin(), left.end());
        for (std::size_t sm = 0; sm < left.size() && num_blocks > 0; ++sm) {
            if (left[sm] + unit <= most || left[sm] < unit) continue;
            left[sm] -= unit;
            --num_blocks;
        }
    }

    Placement placement;
    for (std::size_t sm = 0; sm < free_.size(); ++sm) {
        if (left[sm] == free_[sm]) continue;
        placement.push_back({static_cast<int>(sm), (free_[sm] - left[sm]) / unit});
    }
    free_ = std::move(left);
    return placement;
}

void SmArray::release(const Placement& placement, int blocks_per_sm) {
    for (const Share& share : placement) {
        free_[static_cast<std::size_t>(share.sm)] += share.num_blocks * unit_of(blocks_per_sm);
    }
}

}  // namespace urgengo::simgpu
