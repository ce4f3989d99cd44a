// SPDX-License-Identifier: Apache-2.0
//
// What was learned of each task, as a table to read. Pure.
#pragma once

#include <string>

#include "tools/trace/profile_builder.h"

namespace urgengo::cli {

/// @returns what takes longer, alone: "launch"ing its kernels, or executing them ("GPU"); "-": not
///          known
std::string bound_by(const config::TaskProfile& task);

std::string profile_table(const trace::LearnedProfile& learned);

}  // namespace urgengo::cli
