// SPDX-License-Identifier: Apache-2.0
//
// A kernel pattern as text, the same in YAML and in the resolved JSON: a glob on the name, and
// after an '@' the size: "conv*", "conv*@392x256" (grid blocks x block threads), "conv*@*x256".
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "host/config/config.h"

namespace urgengo::config {

/// What error messages list.
inline constexpr char kKernelPatternAccepted[] =
    "a pattern for kernel names, such as \"conv*\" or \"conv*@392x256\" (grid blocks x block "
    "threads)";

/// @returns nothing if the name is empty or the size is not one
std::optional<KernelPattern> parse_kernel_pattern(std::string_view text);

/// @returns what parse_kernel_pattern() reads back as the same
std::string to_text(const KernelPattern& pattern);

}  // namespace urgengo::config
