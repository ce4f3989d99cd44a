// SPDX-License-Identifier: Apache-2.0
//
// What `urgengo sim --workload` names: a workload.json of `urgengo-chains calibrate`, or a
// chains.yaml, whose program the profile beside it knows (tools/sim/recorded.h).
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "tools/sim/recorded.h"

namespace urgengo::cli {

struct SimWorkload {
    chains::Workload workload;
    std::optional<sim::RecordedProgram> recorded;
    std::string yaml, path;  ///< of that one's config: its text, and how errors call it
    /// Periods and deadlines by load, where a load is not a factor on arrival rates.
    std::map<double, std::vector<sim::ChainTimes>> times;

    std::vector<std::string> names() const;
    /// The same at one load.
    SimWorkload at(double load) const;
    /// @returns the factor on arrival rates that this load is
    double f_a(double load) const { return times.count(load) > 0 ? 1 : load; }
};

/// @param profile  with kernels in columns (tools/sim/compact_profile.py), or as it was recorded
/// @returns the profile as it was recorded; what is no such text, as it is
std::string without_columns(const std::string& profile);

/// @param path     empty: the ten chains as calibrated on an H200
/// @param profile  empty: beside the chains.yaml
/// @errors what is wrong with the file, or not simulated
Result<SimWorkload> read_sim_workload(const std::string& path, const std::string& profile);

}  // namespace urgengo::cli
