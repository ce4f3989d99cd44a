// SPDX-License-Identifier: Apache-2.0
//
// urgengo profile: runs a program twice and learns what its tasks do on the GPU.
//
//   1 write chains.yaml resolved, without any profile (in a folder of our own)
//   2 run the program with a trace being written (traced_run.h) in which every kernel is timed, by
//     CUPTI or by marks; or take a trace that is there
//   3 run it again with a trace in which nothing is timed, as timing slows launching down: launch
//     times, latencies and CPU times are from this one
//   4 learn the profile (tools/trace), merge it if asked to, write it, and print what was learned
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace urgengo::cli {

struct ProfileOptions {
    std::string config;  ///< empty: chains.yaml in the current folder
    std::string out;     ///< empty: <config's stem>.profile.json beside it
    bool isolated = false;
    bool in_situ = false;
    double seconds = 0;           ///< each run; 0: until the program ends
    std::string source = "auto";  ///< by what kernels are timed: auto, cupti, marks
    std::string cupti;            ///< a libcupti; empty: it is looked for
    int passes = 2;               ///< runs of the program: the second one is not timed
    bool merge = false;
    std::string trace;  ///< learn from this one and run nothing
    bool keep_trace = false;
    std::string real_libcuda;
    bool json = false;
};

CLI::App* add_profile(CLI::App& app, ProfileOptions& options);

/// @param program  the program and its arguments; may be empty with a trace
/// @returns an exit code: the program's own if it failed by itself
int cmd_profile(const ProfileOptions& options, const std::vector<std::string>& program);

}  // namespace urgengo::cli
