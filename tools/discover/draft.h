// SPDX-License-Identifier: Apache-2.0
//
// Writes what was discovered as a chains.yaml that is valid as it stands, with a comment on
// everything that a person needs to judge it: what was measured, what is only a guess, what was
// left out.
#pragma once

#include <string>
#include <vector>

#include "tools/discover/activities.h"
#include "tools/discover/rules.h"

namespace urgengo::discover {

/// An activity as it goes into the draft.
struct DraftChain {
    std::string name;
    std::size_t activity = 0;  ///< index in Activities::list
};

struct Draft {
    std::vector<DraftChain> chains;  ///< empty: nothing periodic can be told apart
    std::string yaml;                ///< not valid if there are no chains
};

/// @param program  the command, for the first comment
Draft write_draft(const Observation& observation, const Activities& activities,
                  const std::vector<Rule>& rules, const std::string& program);

}  // namespace urgengo::discover
