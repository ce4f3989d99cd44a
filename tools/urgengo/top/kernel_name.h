// SPDX-License-Identifier: Apache-2.0
//
// A kernel's name for a narrow column: of a mangled one, perhaps cut off, the function's own,
// without namespaces, template arguments and parameters.
#pragma once

#include <string>
#include <string_view>

namespace urgengo::cli {

/// @returns "gemm" of "_ZN3lib4gemmIfEEvPf"; any other name as it is
std::string short_kernel_name(std::string_view name);

}  // namespace urgengo::cli
