// SPDX-License-Identifier: Apache-2.0
//
// The terminal of `urgengo top`: draws lines (top_view.h), and takes keys. The terminal is as it
// was when it returns, and when a signal ends it.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "tools/urgengo/top/top_view.h"

namespace urgengo::cli {

/// @returns the keys, for --help: "q quit, s sort, ..."
std::string top_keys();

/// Shows what `look` finds, every so many seconds, until the user or a signal ends it.
/// @returns true, or why the terminal cannot be used
Result<bool> show_top(TopOptions options, double interval_s,
                      const std::function<std::vector<PageReading>()>& look);

}  // namespace urgengo::cli
