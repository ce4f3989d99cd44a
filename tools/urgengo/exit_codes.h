// SPDX-License-Identifier: Apache-2.0
//
// What `urgengo` exits with when it did not hand over to a program; and the one way to say why.
#pragma once

#include <string>

#include "tools/log/log.h"

namespace urgengo::cli {

inline constexpr int kExitFailure = 1;
inline constexpr int kExitUsage = 2;            ///< wrong options, or a config that is not valid
inline constexpr int kExitNotExecutable = 126;  ///< 126 and 127 as in every shell
inline constexpr int kExitNotFound = 127;
inline constexpr int kExitInterrupted = 130;

/// Prints one line on stderr. @returns the code, to be returned on
inline int fail(int exit_code, const std::string& message) {
    tools::log_error("{}", message);
    return exit_code;
}

}  // namespace urgengo::cli
