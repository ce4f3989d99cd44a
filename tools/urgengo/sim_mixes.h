// SPDX-License-Identifier: Apache-2.0
//
// Results of tools/bench/network_mixes.py, for `urgengo sim --compare`: of one mix, with or without
// the bystander.
#pragma once

#include <string>
#include <vector>

#include "host/config/json_cursor.h"
#include "tools/urgengo/sim_compare.h"

namespace urgengo::cli {

/// @returns whether the file is one
bool has_mixes(const config::JsonCursor& root);

/// Runs of the mix whose networks are the chains of these names; others are left out.
/// How fast programs launch is what UrgenGo measured in those runs (`launch_pace`), the mean by
/// network. The row `priorities` is called what it is: urgengo with the keys that it has.
void read_mixes(const config::JsonCursor& root, const std::vector<std::string>& names,
                bool beside_bystander, Measured& measured);

}  // namespace urgengo::cli
