// SPDX-License-Identifier: Apache-2.0
//
// The row `floor` of `urgengo bench smoke`: what is missed even by a chain that has the machine for
// itself. The same program, bare, once for each chain, with the arrivals that the chain has among
// all; the reports make one, as if of one run, so that the row is read as any other. Pure.
//
// A late frame is finished, as in the bare row: where the next one waits for it and misses, too,
// early exit could have met that one. Else what is missed here is missed by all.
//
// There is no quicker way to it that would be a measurement: arrivals are in real time, chains that
// run at once are not alone, and adding up a chain's calibrated times leaves out what launches and
// waits take, which decides about frames that are close.
#pragma once

#include <string>
#include <vector>

#include "host/base/result.h"

namespace urgengo::cli {

/// @returns the names of the chains in what `urgengo-chains calibrate` wrote
Result<std::vector<std::string>> chain_names(const std::string& workload, const std::string& file);

/// Times become those since each run's start; misses the mean over chains that had a frame; cores
/// and throughput are added up.
/// @param reports  of one run for each of `chains`, in their order; not empty
/// @errors a report that is not of that chain alone, or of other conditions than the first
Result<std::string> combine_reports(const std::vector<std::string>& reports,
                                    const std::vector<std::string>& chains);

}  // namespace urgengo::cli
