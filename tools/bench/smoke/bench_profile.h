// SPDX-License-Identifier: Apache-2.0
//
// What a bench says of the profiles that its rows ran with.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "tools/bench/smoke/bench_plan.h"

namespace urgengo::cli {

struct ProfiledTask {
    std::string chain, task;
    std::uint32_t instances = 0;  ///< that it was learned from
};

struct ProfileSummary {
    bool hints = true;
    std::string way;  ///< given | in-situ | isolated
    double seconds = 0;
    std::vector<ProfiledTask> tasks;
};

/// @errors the file's, or the tasks that it knows nothing of
Result<ProfileSummary> summarize_profile(const PlannedProfile& planned);

/// @returns one line: how it was learned, and from how many instances at least
std::string describe(const ProfileSummary& summary);

}  // namespace urgengo::cli
