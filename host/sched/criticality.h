// SPDX-License-Identifier: Apache-2.0
//
// A chain at its limit of misses in a row goes before all that are not, by their own criticality.
#pragma once

#include <cstdint>

#include "host/config/limits.h"
#include "host/sched/governed.h"

namespace urgengo::sched {

inline std::uint16_t criticality(const GovernedChain& chain) {
    const int most = chain.max_consecutive_misses();
    const bool at_limit = most > 0 && chain.misses_in_a_row.load(std::memory_order_relaxed) >=
                                          static_cast<std::uint64_t>(most);
    return static_cast<std::uint16_t>(chain.criticality() +
                                      (at_limit ? config::kCriticality.max + 1 : 0));
}

}  // namespace urgengo::sched
