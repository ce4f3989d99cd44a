// SPDX-License-Identifier: Apache-2.0
#include "host/config/profile_match.h"

namespace urgengo::config {
namespace {

std::string quoted(const std::string& text) {
    return "'" + text + "'";
}

void compare(const char* what, const std::string& profile, const std::string& target,
             std::vector<std::string>& complaints) {
    if (profile.empty() || target.empty() || profile == target) return;
    complaints.push_back(std::string(what) + ": found " + quoted(profile) +
                         " in the profile, accepted: " + quoted(target) + ", as it is here");
}

std::string mhz(std::uint32_t clock) {
    return clock == 0 ? "" : std::to_string(clock) + " MHz";
}

}  // namespace

ProfileMatch profile_matches(const Profile& profile, const RunTarget& target) {
    ProfileMatch match;
    compare("gpu", profile.gpu, target.gpu, match.refusals);
    compare("program", profile.program, target.program, match.refusals);
    compare("driver", profile.driver, target.driver, match.warnings);
    compare("sm_clock", mhz(profile.sm_clock_mhz), mhz(target.sm_clock_mhz), match.warnings);
    compare("memory_clock", mhz(profile.memory_clock_mhz), mhz(target.memory_clock_mhz),
            match.warnings);
    return match;
}

}  // namespace urgengo::config
