// SPDX-License-Identifier: Apache-2.0
//
// The names of all kernels of a profile, which tell one build of a program from another.
#pragma once

#include <cstdint>
#include <set>
#include <string>

#include "host/config/config.h"

namespace urgengo::trace {

std::set<std::string> kernel_names(const config::Profile& profile);

/// @returns Profile::kernel_set_hash of these names; 0 if there are none
std::uint64_t kernel_set_hash(const std::set<std::string>& names);

}  // namespace urgengo::trace
