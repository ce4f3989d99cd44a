// SPDX-License-Identifier: Apache-2.0
//
// Results of several invocations of a bench, on several GPUs perhaps, as if they came from one.
#pragma once

#include <string>
#include <vector>

#include "host/base/result.h"
#include "tools/bench/smoke/bench_results.h"

namespace urgengo::cli {

/// @param texts  JSON of `urgengo bench smoke`, one or more; `files` is what errors call them
/// @returns all runs; rows, loads and seeds may differ from text to text
/// @errors what is wrong with a text; conditions that differ (GPU, driver, version, workload, or
///         any option but rows, loads, seeds and repeats); a run that is there twice, or missing
///         where other rows have it
Result<BenchResults> merge_results(const std::vector<std::string>& texts,
                                   const std::vector<std::string>& files);

}  // namespace urgengo::cli
