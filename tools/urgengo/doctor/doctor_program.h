// SPDX-License-Identifier: Apache-2.0
//
// doctor: our own library, and whether it gets into a program.
#pragma once

#include <string>
#include <vector>

#include "host/base/result.h"
#include "tools/urgengo/doctor/doctor_report.h"
#include "tools/urgengo/environment.h"

namespace urgengo::cli {

struct ProgramFindings {
    Findings findings;
    std::string name;    ///< as profiles know it
    std::string driver;  ///< that the program names itself; empty: it leaves that to the machine
};

Findings check_library(const Result<std::string>& interposer);

/// @param program  the program and its arguments; empty: none was named
ProgramFindings check_program_file(const std::vector<std::string>& program,
                                   const Environment& environment);

}  // namespace urgengo::cli
