// SPDX-License-Identifier: Apache-2.0
//
// What a run under UrgenGo found to be other than its config and profile say, from its statistics:
// estimates that were corrected, what the guard chose and why, late starts, streams not followed.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "host/base/result.h"

namespace urgengo::cli {

struct ChainFindings {
    std::string name;
    std::string guard;  ///< the mode that it gave the chain at the end
    std::uint64_t instances = 0, late_starts = 0, early_frames = 0;
    std::uint64_t unknown = 0;  ///< launches that the profile does not know
};

struct RunFindings {
    std::string file, mode, tripped, guard;
    std::vector<std::string> warnings;  ///< as the run said them at its end
    bool has_warnings = true;           ///< else the version that ran wrote none
    std::vector<ChainFindings> chains;
};

/// @param file  that URGENGO_STATS, or `urgengo run --stats`, named
/// @errors one line: it cannot be read, or is something else
Result<RunFindings> read_run_findings(const std::string& file);

std::string format_run_findings(const RunFindings& findings);
nlohmann::ordered_json run_findings_json(const RunFindings& findings);

}  // namespace urgengo::cli
