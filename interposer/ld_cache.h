// SPDX-License-Identifier: Apache-2.0
//
// Reads the loader's cache (/etc/ld.so.cache): where would the loader find a library by its name?
// Needed because asking the loader itself for "libcuda.so.1" would give us ourselves.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace urgengo::interposer {

/// @param cache  the file's contents, in glibc's format (since 2.2); anything else gives no result
/// @returns the paths of this machine's architecture that the cache lists for `soname`, in its
/// order
std::vector<std::string> find_in_ld_cache(std::string_view cache, std::string_view soname);

}  // namespace urgengo::interposer
