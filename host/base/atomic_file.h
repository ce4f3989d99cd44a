// SPDX-License-Identifier: Apache-2.0
//
// Files are written whole or not at all: to a temporary name beside the target, then renamed.
#pragma once

#include <string>
#include <string_view>

#include "host/base/result.h"

namespace urgengo {

/// @returns true, or the error: the path, the step that failed and the system's reason
Result<bool> write_file_atomically(const std::string& path, std::string_view content);

}  // namespace urgengo
