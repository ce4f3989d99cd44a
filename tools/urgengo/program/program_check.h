// SPDX-License-Identifier: Apache-2.0
//
// Finds a program as a shell does, and says beforehand when the loader will not let us into it.
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace urgengo::cli {

struct FoundProgram {
    std::string path;     ///< empty if there is none
    int exit_code = 0;    ///< what to exit with then: 126 not executable, 127 not found
    std::string message;  ///< and what to say
};

/// @param search_path  $PATH, for a name without a slash
FoundProgram find_program(const std::string& name, const std::string& search_path);

/// Who starts a program, and where it is looked for.
struct ProgramUser {
    uid_t uid = 0;
    gid_t gid = 0;
    std::string search_path{};                ///< $PATH, for a script's "#!/usr/bin/env python3"
    std::vector<std::string> library_path{};  ///< $LD_LIBRARY_PATH
};

struct ProgramCheck {
    std::string file;     ///< the executable that runs in the end: a script's interpreter
    std::string refusal;  ///< one line: file, found, accepted; empty: we can be loaded into it
    std::vector<std::string> warnings;
    std::string driver;  ///< the driver's library that the program names by itself (DT_NEEDED with
                         ///< a path, RPATH); empty: the one that the machine has
};

/// Whether the loader lets us into the program if this user starts it. Refused: setuid, setgid and
/// file capabilities, static linking, another processor or loader. Warned of: a driver that the
/// program may open by a fixed path, past us. Scripts are followed to their interpreter.
ProgramCheck check_program(const std::string& path, const ProgramUser& user);

}  // namespace urgengo::cli
