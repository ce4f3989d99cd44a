// SPDX-License-Identifier: Apache-2.0
//
// A whole file as a string, and the hash by which the resolved config recognises it.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "host/base/result.h"

namespace urgengo::config {

/// Reads a regular file of at most 64 MiB.
/// @errors names the path and the reason; never throws but std::bad_alloc
Result<std::string> read_file(const std::string& path);

/// FNV-1a, 64 bits: recognises an edited file. Not a defence against a forged one.
std::uint64_t fnv1a64(std::string_view text);

}  // namespace urgengo::config
