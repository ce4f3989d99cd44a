// SPDX-License-Identifier: Apache-2.0
//
// urgengo doctor: what this GPU, driver and account allow, whether a program would be scheduled,
// and what each `auto` of its config comes to. One file a topic: doctor_*.h. Whatever asks the
// driver does so in a child and for a limited time.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace urgengo::cli {

struct DoctorOptions {
    std::string config;  ///< empty: chains.yaml in the current folder, if it is there
    bool json = false;
    bool no_probe = false;
    std::string real_libcuda;
};

CLI::App* add_doctor(CLI::App& app, DoctorOptions& options);

/// @param program  the program and its arguments; may be empty. It is looked at, not started
/// @returns 0 if UrgenGo can schedule, warnings or not; 1 if something prevents it; 2 for wrong
///          usage
int cmd_doctor(const DoctorOptions& options, const std::vector<std::string>& program);

}  // namespace urgengo::cli
