// SPDX-License-Identifier: Apache-2.0
//
// How sure is a miss ratio? Frames that follow each other are late together, so n frames tell less
// than n draws would. The run is cut into blocks; how much more their miss ratios differ than those
// of independent frames would is the design effect, by which n is divided. The interval is Wilson's
// (1927), which holds for ratios near 0 as well.
#pragma once

#include <vector>

namespace urgengo::report {

struct MissRatio {
    double ratio = 0, low = 0, high = 1;  ///< 0..1; 95 %
};

/// @param missed  of the frames, in the order of their arrivals
MissRatio miss_ratio(const std::vector<bool>& missed);

}  // namespace urgengo::report
