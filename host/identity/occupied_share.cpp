// SPDX-License-Identifier: Apache-2.0
#include "host/identity/occupied_share.h"

#include <algorithm>

namespace urgengo::identity {
namespace {

/// Warps a multiprocessor that keep it busy: half of what it holds. More of them wait for each
/// other.
constexpr double kBusyShareOfWarps = 0.5;

}  // namespace

double occupied_share(const exec::DriverApi& driver, const Launch& launch,
                      const exec::MarkContext& context) {
    const double blocks = static_cast<double>(launch.grid_blocks);
    double share = blocks * launch.block_threads / (context.resident_threads * kBusyShareOfWarps);
    int per_sm = 0;
    if (driver.cuOccupancyMaxActiveBlocksPerMultiprocessor &&
        driver.cuOccupancyMaxActiveBlocksPerMultiprocessor(&per_sm, launch.function,
                                                           static_cast<int>(launch.block_threads),
                                                           launch.shared_bytes) == CUDA_SUCCESS &&
        per_sm > 0)
        share = std::max(share, blocks / (static_cast<double>(per_sm) * context.num_sms));
    return std::min(1.0, share);
}

}  // namespace urgengo::identity
