// SPDX-License-Identifier: Apache-2.0
//
// How many tasks chains have in all.
#pragma once

#include <cstddef>
#include <span>

#include "host/config/config.h"

namespace urgengo::config {

inline std::size_t num_tasks(std::span<const Chain> chains) {
    std::size_t count = 0;
    for (const Chain& chain : chains) count += chain.tasks.size();
    return count;
}

}  // namespace urgengo::config
