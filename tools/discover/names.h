// SPDX-License-Identifier: Apache-2.0
//
// Names for people, and patterns for fnmatch and YAML, out of what was seen in a program.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace urgengo::discover {

/// @returns a kernel's name without parameters, template arguments and namespaces, as one would say
///          it: "vectorized_elementwise_kernel" for at::native's
std::string short_kernel_name(const std::string& mangled);

/// @returns the text with nothing but letters, digits, '_' and '-', at most 32; "chain" if that is
///          nothing
std::string readable(const std::string& text);

/// @returns `name`, or with "_2", "_3", ... the first that is not in `taken`, which it is added to
std::string unique_name(const std::string& name, std::vector<std::string>& taken);

/// @returns a pattern that matches this text; what cannot be written in YAML is matched by '?'
std::string escape_glob(std::string_view text);

bool matches_glob(const std::string& glob, std::string_view text);

/// @returns the text in double quotes, as YAML reads it back
std::string yaml_quoted(std::string_view text);

/// @returns the text with every control character and byte above 126 replaced by '?', for comments
std::string printable(std::string_view text);

}  // namespace urgengo::discover
