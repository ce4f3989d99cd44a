// SPDX-License-Identifier: Apache-2.0
//
// Under what the program runs, for readers of its records (abi/run_record.h): command, machine,
// the config as it is used, and the kernels that are planned. Asks the driver nothing.
#pragma once

#include <string>

#include "host/config/config.h"

namespace urgengo::interposer {

/// @param profile  null: no task has a plan. Else "kernels" has the names of what is planned, each
///                 once, and for each task its launches as indices of them
/// @param file     that the config was read from
/// @returns a JSON object
std::string run_conditions(const config::Config& config, const config::Profile* profile,
                           const std::string& file);

}  // namespace urgengo::interposer
