// SPDX-License-Identifier: Apache-2.0
//
// A bench's results as one HTML file that needs nothing else: no script, no font, no network.
#pragma once

#include <string>

#include "tools/bench/smoke/bench_results.h"

namespace urgengo::cli {

std::string html_report(const BenchResults& results);

}  // namespace urgengo::cli
