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
/// The same of a file that is this process' user's own, and no link: of the very file that is read.
Result<std::string> read_own_file(const std::string& path);

}  // namespace urgengo::config
