// SPDX-License-Identifier: Apache-2.0
//
// What every command that starts a program under UrgenGo does first: find it, find our library, and
// make sure that the loader lets the one into the other.
#pragma once

#include <string>
#include <vector>

#include "tools/urgengo/environment.h"
#include "tools/urgengo/program/program_check.h"

namespace urgengo::cli {

struct ProgramSetup {
    int exit_code = 0;    ///< not 0: it cannot be done, and
    std::string message;  ///< why: one line
    std::string path;     ///< the program, as exec wants it
    std::string name;     ///< its file name, which profiles know it by
    std::string interposer;
    std::string real_libcuda;  ///< the driver to be used; empty: the interposer searches
    std::string driver;        ///< the driver's file that this comes to; empty: none was found
    std::vector<std::string> warnings;
};

/// @param program       the program and its arguments
/// @param chosen        the library to preload; empty: the one beside us
/// @param real_libcuda  the user's choice of driver; empty: the environment's, else the one that
/// the
///                      program names itself, else none
ProgramSetup set_up_program(const std::vector<std::string>& program,
                            const std::string& real_libcuda, const Environment& environment,
                            const std::string& chosen = {});

/// Who starts the program, as this environment says.
ProgramUser program_user(const Environment& environment);

/// @returns why the loader cannot preload from there: one line; empty if it can
std::string why_not_preloadable_from(const std::string& interposer);

/// @param asked         the user's choice of driver
/// @param programs_own  the one that the program names itself
/// @returns the absolute path of the driver to be used: the first that is not empty of asked, the
///          environment's, the program's unless it is `interposer`; empty if all are
std::string choose_driver(const std::string& asked, const Environment& environment,
                          const std::string& programs_own, const std::string& interposer);

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
