// SPDX-License-Identifier: Apache-2.0
//
// What every command that starts a program under UrgenGo does first: find it, find our library, and
// make sure that the loader lets the one into the other.
#pragma once

#include <string>
#include <vector>

#include "tools/urgengo/environment.h"

namespace urgengo::cli {

struct ProgramSetup {
    int exit_code = 0;    ///< not 0: it cannot be done, and
    std::string message;  ///< why: one line
    std::string path;     ///< the program, as exec wants it
    std::string name;     ///< its file name, which profiles know it by
    std::string interposer;
    std::string real_libcuda;  ///< the driver to be used; empty: the interposer searches
    std::vector<std::string> warnings;
};

/// @param program       the program and its arguments
/// @param real_libcuda  the user's choice of driver; empty: the environment's, else the one that
/// the
///                      program names itself, else none
ProgramSetup set_up_program(const std::vector<std::string>& program,
                            const std::string& real_libcuda, const Environment& environment);

/// @returns the absolute path; empty for empty. The program may change its folder before it opens
///          the file.
std::string absolute(const std::string& path);

/// @returns what this variable says; empty if it is not there
std::string value_of(const Environment& environment, const std::string& name);

/// Prints each warning on stderr, one line each.
void warn(const std::vector<std::string>& warnings);

/// Becomes the program. @returns an exit code, only if that failed
int become(const ProgramSetup& setup, std::vector<std::string> arguments,
           const Environment& environment);

}  // namespace urgengo::cli
