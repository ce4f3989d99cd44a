// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fnmatch.h>

#include <string>

namespace urgengo::identity {

/// @returns whether the name fits the pattern, as the config's patterns are meant
inline bool glob_fits(const std::string& glob, const char* name) {
    return fnmatch(glob.c_str(), name, 0) == 0;
}

}  // namespace urgengo::identity
