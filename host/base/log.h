// SPDX-License-Identifier: Apache-2.0
//
// The few lines that UrgenGo says inside somebody else's program: on stderr, one line each, with
// the prefix "urgengo:". Never stdout, never on a launch path.
#pragma once

#include <string_view>

namespace urgengo {

void log_line(std::string_view message);

}  // namespace urgengo
