// SPDX-License-Identifier: Apache-2.0
//
// Where a libcupti may be. Only asked by `urgengo profile`'s runs. Touches no CUDA; dlopen() of
// what it names is the caller's.
//
//  1 One that the program has mapped already, by its name (a wheel brings its own, and two in one
//    process do not agree).
//  2 The one that was asked for.
//  3 Beside the libraries that the program has mapped: a toolkit's extras/CUPTI, the folders of
//    the wheels nvidia-cuda-cupti and nvidia-cuda-cupti-cu12.
//  4 Where toolkits are mostly installed.
#pragma once

#include <string>
#include <vector>

namespace urgengo::exec {

/// Names of 1, to be looked for among what is mapped (RTLD_NOLOAD).
const std::vector<std::string>& cupti_names();

/// @param asked   a file; may be empty
/// @param mapped  paths of the libraries that the process has mapped
/// @param home    CUDA_HOME or CUDA_PATH; may be empty
/// @returns files of 2 to 4, in this order, each once; most will not exist
std::vector<std::string> cupti_candidates(const std::string& asked,
                                          const std::vector<std::string>& mapped,
                                          const std::string& home);

}  // namespace urgengo::exec
