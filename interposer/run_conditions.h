// SPDX-License-Identifier: Apache-2.0
//
// Under what the program runs, for readers of its records (abi/run_record.h): command, machine,
// and the config as it is used. Asks the driver nothing.
#pragma once

#include <string>

#include "host/config/config.h"

namespace urgengo::interposer {

/// @param file  that the config was read from
/// @returns a JSON object
std::string run_conditions(const config::Config& config, const std::string& file);

}  // namespace urgengo::interposer
