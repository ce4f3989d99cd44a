// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/collision.h"

namespace urgengo::trace {

std::vector<bool> colliding(std::span<const ChainOnGpu> chains) {
    std::vector<bool> collides(chains.size());
    for (std::size_t urgent = 0; urgent < chains.size(); ++urgent)
        for (std::size_t other = 0; other < chains.size(); ++other) {
            if (chains[other].deadline_ns <= chains[urgent].deadline_ns) continue;
            if (chains[other].priority > chains[urgent].priority) continue;
            collides[urgent] = collides[other] = true;
        }
    return collides;
}

}  // namespace urgengo::trace
