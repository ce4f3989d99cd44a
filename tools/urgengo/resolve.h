// SPDX-License-Identifier: Apache-2.0
//
// From chains.yaml and its profile to the one resolved file that the interposer reads.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "host/config/config.h"
#include "host/config/profile_match.h"

namespace urgengo::cli {

struct ResolveRequest {
    std::string yaml;
    std::string profile;       ///< empty: <stem>.profile.json beside the YAML, if there is one
    std::string preset;        ///< empty: the YAML's
    bool allow_stale = false;  ///< a profile of another GPU or program is a warning, not an error
    /// Asked only if there is a profile; null: it may be of any GPU and program.
    std::function<config::RunTarget()> target{};
    /// Asked what `priority_via: auto` stands for, only if it is there; null: it is written as it
    /// is.
    std::function<config::PriorityVia(const config::Config&)> priority_via{};
};

struct ResolvedFile {
    config::Config config;
    std::string path;  ///< absolute
    std::vector<std::string> warnings;
};

/// Validates both files and writes <stem>.resolved.json beside the YAML, or in the session's folder
/// if that one cannot be written to. With a preset: <stem>.<preset>.resolved.json, so that it is
/// never taken for the YAML's own.
/// @errors what is wrong with either file, or why the profile is refused; nothing is written then
Result<ResolvedFile> resolve(const ResolveRequest& request);

}  // namespace urgengo::cli
