// SPDX-License-Identifier: Apache-2.0
//
// The libraries of this process, by path. Not on a launch path: takes the loader's lock, though not
// the one that it has while constructors run.
#pragma once

#include <string>
#include <vector>

namespace urgengo {

/// @returns paths of the libraries that this process has mapped
/// @threads any
std::vector<std::string> mapped_libraries();

}  // namespace urgengo
