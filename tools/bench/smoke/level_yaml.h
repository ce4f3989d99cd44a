// SPDX-License-Identifier: Apache-2.0
//
// A config for another load: the same chains.yaml with periods divided; or for another scheduler.
#pragma once

#include <chrono>
#include <string>

#include "host/base/result.h"

namespace urgengo::cli {

/// @param f_a, f_d  factors on arrival rates and on deadlines, > 0
/// @returns the YAML's text with every period divided by f_a and every deadline times f_d; comments
///          are left out
/// @errors what is wrong with the YAML; `file` is what they call it
Result<std::string> scale_level(const std::string& yaml, const std::string& file, double f_a,
                                double f_d = 1);

/// @param section  "scheduler" or "cpu"
/// @param keys     a YAML map, "{tracking: batched}"
/// @returns the YAML's text with these keys set in that section, in the place of its own
/// @errors what is wrong with the outcome; `file` is what they call it
Result<std::string> set_keys(const std::string& yaml, const std::string& file,
                             const std::string& section, const std::string& keys);

/// @returns the longest period of any chain
/// @errors what is wrong with the YAML
Result<std::chrono::nanoseconds> longest_period(const std::string& path);

}  // namespace urgengo::cli
