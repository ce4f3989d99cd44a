// SPDX-License-Identifier: Apache-2.0
//
// Which activities always follow which: a frame of one begins right after a frame of the other has
// ended, at the same rate. Then they are likely the tasks of one chain.
#pragma once

#include <cstddef>
#include <vector>

#include "tools/discover/activities.h"

namespace urgengo::discover {

struct Follows {
    std::size_t first = 0, second = 0;  ///< indices in Activities::list
    double gap_ns = 0;                  ///< from the one's end to the other's begin: median
};

std::vector<Follows> find_follows(const Activities& activities);

}  // namespace urgengo::discover
