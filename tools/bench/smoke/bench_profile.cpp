// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/bench_profile.h"

#include <fmt/format.h>

#include <algorithm>

#include "host/config/profile_reader.h"

namespace urgengo::cli {

Result<ProfileSummary> summarize_profile(const PlannedProfile& planned) {
    const auto profile = config::read_profile(planned.path);
    if (!profile) return Error{profile.error()};
    ProfileSummary summary{planned.hints, planned.way, planned.seconds, {}};
    std::string empty;
    for (const config::ChainProfile& chain : profile->chains) {
        for (const config::TaskProfile& task : chain.tasks) {
            summary.tasks.push_back({chain.name, task.name, task.instances});
            if (task.kernels.empty()) empty += " " + chain.name + "." + task.name;
        }
    }
    if (!empty.empty()) {
        return Error{planned.path + ": found no kernel of" + empty +
                     ", accepted: a profile of every task (a longer --profile-seconds?)"};
    }
    return summary;
}

std::string describe(const ProfileSummary& summary) {
    std::uint32_t least = UINT32_MAX;
    for (const ProfiledTask& task : summary.tasks) least = std::min(least, task.instances);
    const std::string how = summary.way == "given"
                                ? "given"
                                : fmt::format("learned {} in {} s at f_a {}", summary.way,
                                              summary.seconds, kProfileLoad);
    return fmt::format("{}{}, from {} or more instances of each task",
                       summary.hints ? "" : "without hints: ", how,
                       summary.tasks.empty() ? 0 : least);
}

}  // namespace urgengo::cli
