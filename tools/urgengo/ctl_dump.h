// SPDX-License-Identifier: Apache-2.0
//
// urgengo ctl dump: copies the flight recorder of a process to a file, at once or when a chain
// misses its deadline. All of it is seen from outside: the process is not asked.
#pragma once

#include "tools/urgengo/cmd_ctl.h"

namespace urgengo::cli {

/// @returns an exit code
int ctl_dump(const CtlOptions& options);

/// @param path    of a dump; "%n" in it stands for its number
/// @param number  from 1
/// @param most    dumps in all: if more than one, the name without "%n" gets the number at its end
std::string dump_name(const std::string& path, std::uint32_t number, std::uint32_t most);

}  // namespace urgengo::cli
