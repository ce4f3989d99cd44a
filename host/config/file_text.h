// SPDX-License-Identifier: Apache-2.0
//
// A whole file as a string.
#pragma once

#include <string>

#include "host/base/result.h"

namespace urgengo::config {

/// Reads a regular file of at most 64 MiB.
/// @errors names the path and the reason; never throws but std::bad_alloc
Result<std::string> read_file(const std::string& path);

}  // namespace urgengo::config
