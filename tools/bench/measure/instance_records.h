// SPDX-License-Identifier: Apache-2.0
//
// Where instances are found: the true ones in the workload program's report, the detected ones in a
// trace of the same run.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "host/config/config.h"
#include "tools/bench/measure/instance_match.h"
#include "tools/trace/trace_reader.h"

namespace urgengo::cli {

/// By chain's name. Frames that never began are left out.
using TrueFrames = std::map<std::string, std::vector<TrueFrame>>;

/// @param report  JSON that `urgengo-chains run --instances` wrote
/// @errors what is wrong with it; `file` is what they call it
Result<TrueFrames> parse_true_frames(const std::string& report, const std::string& file);

using DetectedInstances = std::map<std::string, std::vector<DetectedInstance>>;

/// @param config  of the run: one task a chain, so that an instance of it is a frame
/// @returns every chain's, perhaps none, in no order
/// @errors a config with a chain of several tasks, or a task in the trace that it has not
Result<DetectedInstances> detected_instances(const trace::Trace& trace,
                                             const config::Config& config);

}  // namespace urgengo::cli
