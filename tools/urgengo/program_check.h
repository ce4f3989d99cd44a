// SPDX-License-Identifier: Apache-2.0
//
// Finds a program as a shell does, and says beforehand when the loader will not let us into it.
#pragma once

#include <sys/types.h>

#include <string>

namespace urgengo::cli {

struct FoundProgram {
    std::string path;     ///< empty if there is none
    int exit_code = 0;    ///< what to exit with then: 126 not executable, 127 not found
    std::string message;  ///< and what to say
};

/// @param search_path  $PATH, for a name without a slash
FoundProgram find_program(const std::string& name, const std::string& search_path);

/// @returns why the loader would ignore LD_PRELOAD in this program if this user starts it: setuid,
///          setgid, file capabilities, statically linked, not a 64-bit program; empty if it would
///          not
std::string why_not_preloadable(const std::string& path, uid_t uid, gid_t gid);

}  // namespace urgengo::cli
