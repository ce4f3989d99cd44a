// SPDX-License-Identifier: Apache-2.0
//
// Prints the metrics once, or serves them by HTTP until a signal comes.
#pragma once

#include "tools/urgengo/cmd_export.h"

namespace urgengo::cli {

/// @returns an exit code
int serve_metrics(const ExportOptions& options);

}  // namespace urgengo::cli
