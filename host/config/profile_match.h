// SPDX-License-Identifier: Apache-2.0
//
// Whether a profile was learned on this GPU, from this program. For tools; that the kernels are the
// profile's is only known once the program runs.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "host/config/config.h"

namespace urgengo::config {

/// What a program is about to run as. Empty or 0: not known, and not compared.
struct RunTarget {
    std::string gpu;
    std::string driver;  ///< as Profile::driver
    std::uint32_t sm_clock_mhz = 0;
    std::uint32_t memory_clock_mhz = 0;
    std::string program;  ///< as Profile::program
};

struct ProfileMatch {
    std::vector<std::string> refusals;  ///< why its times are not this run's; empty: it is accepted
    std::vector<std::string> warnings;  ///< why they may be a little off
};

/// Another GPU or program is a refusal, another driver or clock a warning: each one line that says
/// what was found and what is accepted.
ProfileMatch profile_matches(const Profile& profile, const RunTarget& target);

}  // namespace urgengo::config
