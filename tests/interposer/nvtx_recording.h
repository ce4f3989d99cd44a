// SPDX-License-Identifier: Apache-2.0
//
// Runs a twin with the recorder (nvtx_recorder.h) as its NVTX tool.
#pragma once

#include <string>
#include <vector>

#include "tests/interposer/run_twin.h"

namespace urgengo::testing {

struct Recording {
    Outcome outcome;
    std::vector<std::string> lines;  ///< that the tool has written
};

/// The recorder is the program's tool.
inline Environment with_recorder(Environment environment, const std::string& lacks = "") {
    environment["NVTX_INJECTION64_PATH"] = NVTX_RECORDER_PATH;
    environment["NVTX_RECORDER_LACKS"] = lacks;
    return environment;
}
/// UrgenGo is, and the recorder is behind it.
inline Environment behind_us(Environment environment, const std::string& tool) {
    environment["NVTX_INJECTION64_PATH"] = INTERPOSER_FOLDER "/libcuda.so.1";
    environment["URGENGO_NVTX_TOOL"] = tool;
    return environment;
}

inline Recording record(const std::vector<std::string>& arguments, Environment environment) {
    const Folder folder;
    const auto file = folder.path() / "recorded";
    environment["NVTX_RECORDER_FILE"] = file.string();
    Recording recording;
    recording.outcome = run_twin(arguments, environment);
    if (std::filesystem::exists(file)) recording.lines = lines_of(read_text(file));
    return recording;
}

/// @returns those that say what breaks NVTX's protocol
inline std::vector<std::string> errors_of(const std::vector<std::string>& lines) {
    std::vector<std::string> errors;
    for (const std::string& line : lines)
        if (line.starts_with("ERROR")) errors.push_back(line);
    return errors;
}

}  // namespace urgengo::testing
