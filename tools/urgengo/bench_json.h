// SPDX-License-Identifier: Apache-2.0
//
// The raw record of a bench: conditions, and every run's own JSON, whole.
#pragma once

#include <string>

#include "tools/urgengo/bench_results.h"

namespace urgengo::cli {

std::string to_json(const BenchResults& results);

}  // namespace urgengo::cli
