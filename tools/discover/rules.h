// SPDX-License-Identifier: Apache-2.0
//
// How a launch can be known to be of an activity, in the words of chains.yaml.
//
//  1 By the thread's name, if no other thread of that name launches anything, and the thread runs
//    nothing else.
//  2 By a kernel: the first in its frames that no other activity launches, by name, else by name
//  and
//    size. The first of all is best; a later one ties the thread to the task all the same, but the
//    very first frame is taken for another activity's.
//  3 By an NVTX range that has all of its launches and no others. Numbers in the range's name
//    may differ.
//  4 Activities that begin alike and that nothing tells apart are one.
//
// Launches while the program starts up, by threads that run nothing later, do not count as others'
// if they are few.
#pragma once

#include <string>
#include <vector>

#include "host/config/config.h"
#include "tools/discover/activities.h"

namespace urgengo::discover {

struct Rule {
    std::string thread_glob;
    std::string nvtx_glob;
    std::vector<config::KernelPattern> kernels;
    std::string seen_name;  ///< of the thread, the kernel (mangled) or the range that it is from
    std::size_t kernel_index = 0;  ///< position of the kernel in the frame

    bool found() const { return !seen_name.empty(); }
};

/// May merge activities (4).
/// @returns a rule for each activity; not found() if nothing tells it from others
std::vector<Rule> choose_rules(const Observation& observation, Activities& activities);

}  // namespace urgengo::discover
