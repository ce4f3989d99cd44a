// SPDX-License-Identifier: Apache-2.0
//
// urgengo sim: what `urgengo bench smoke` measures, in virtual time: no GPU, the same result on any
// machine (tools/sim). Its JSON is that of `bench smoke`.
#pragma once

#include <string>
#include <vector>

#include "tools/urgengo/sim_options.h"

namespace urgengo::cli {

/// @param arguments  of the command line, for the record
/// @returns an exit code
int cmd_sim(const SimOptions& given, const std::vector<std::string>& arguments);

}  // namespace urgengo::cli
