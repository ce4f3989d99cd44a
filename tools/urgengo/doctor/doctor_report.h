// SPDX-License-Identifier: Apache-2.0
//
// What `urgengo doctor` found: one line a topic, for people and as JSON.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace urgengo::cli {

enum class Verdict {
    kOk,    ///< nothing to do
    kWarn,  ///< works, but less well, or not for everything
    kBad,   ///< nothing will be scheduled
};

struct Finding {
    std::string topic;  ///< "compute mode"
    Verdict verdict = Verdict::kOk;
    std::string found;  ///< one line: what was found; for a warning, what follows from it
};

using Findings = std::vector<Finding>;

void append(Findings& all, Findings more);

/// @returns the worst of them
Verdict worst(const Findings& findings);

/// @returns one line a finding: verdict, topic, what was found; and one for the whole
std::string to_text(const Findings& findings);

/// @returns {"verdict": "ok", "findings": [{"topic": ..., "verdict": ..., "found": ...}]}
nlohmann::json to_json(const Findings& findings);

}  // namespace urgengo::cli
