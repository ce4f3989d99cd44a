// SPDX-License-Identifier: Apache-2.0
//
// A copy of our library that exports no name that this machine's driver lacks. A program linked
// with -z now has all its names looked up before anything of ours can run: if the driver lacks one
// it must fail at its start, as it does without us, and so we must not offer the name either.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "host/base/result.h"
#include "tools/urgengo/environment.h"

namespace urgengo::cli {

/// @returns $XDG_CACHE_HOME/urgengo, else ~/.cache/urgengo; empty if neither is known
std::string cache_folder(const Environment& environment);

/// @returns how many names our library has that the driver lacks; 0 if that cannot be told
std::size_t count_missing_names(const std::string& interposer, const std::string& driver);

/// @returns whether the driver has the name and our library does not
bool lacks_name_of(const std::string& interposer, const std::string& driver, std::string_view name);

/// Makes the copy, unless the driver has all our names or the copy is there from before. The copy's
/// folder is named after the contents of our library and the names that were left out. Where a copy
/// is made, those that nothing was started with for 30 days are removed. (Of a program that runs
/// for longer the children preload from there: without the file they start unscheduled.)
/// @param driver  path of the real libcuda.so.1; empty: there is none, and nothing to leave out
/// @returns the library to preload, or why the copy could not be written
Result<std::string> library_without_missing_names(const std::string& interposer,
                                                  const std::string& driver,
                                                  const std::string& cache_folder);

}  // namespace urgengo::cli
