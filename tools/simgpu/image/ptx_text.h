// SPDX-License-Identifier: Apache-2.0
//
// The entries of a PTX text and their parameters.
#pragma once

#include <map>
#include <string>
#include <string_view>

#include "tools/simgpu/image/image.h"

namespace urgengo::simgpu {

/// @returns whether the text is PTX: its first statement is .version
bool is_ptx(std::string_view text);

std::map<std::string, KernelImage> read_ptx_entries(std::string_view text);

}  // namespace urgengo::simgpu
