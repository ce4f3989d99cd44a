// SPDX-License-Identifier: Apache-2.0
//
// What `urgengo export` tells of processes, as families of metrics by Prometheus' conventions: base
// units, `_total` for what only grows. docs/configuration.md lists them.
#pragma once

#include <prometheus/metric_family.h>

#include <vector>

#include "tools/urgengo/page/frame_follower.h"
#include "tools/urgengo/page/page_reader.h"

namespace urgengo::cli {

struct ExportedProcess {
    PageReading page;
    std::vector<FollowedFrames> frames;  ///< by chain; empty: its rings cannot be followed
};

/// @returns families, sorted as they are documented; those without a metric are not among them
std::vector<prometheus::MetricFamily> metric_families(
    const std::vector<ExportedProcess>& processes);

}  // namespace urgengo::cli
