// SPDX-License-Identifier: Apache-2.0
//
// From chains.yaml and its profile to the one resolved file that the interposer reads.
#pragma once

#include <string>
#include <vector>

#include "host/base/result.h"
#include "host/config/config.h"

namespace urgengo::cli {

struct ResolveRequest {
    std::string yaml;
    std::string profile;  ///< empty: <stem>.profile.json beside the YAML, if there is one
    std::string preset;   ///< empty: the YAML's
};

struct ResolvedFile {
    config::Config config;
    std::string path;  ///< absolute
    std::vector<std::string> warnings;
};

/// Validates both files and writes <stem>.resolved.json beside the YAML, or in the session's folder
/// if that one cannot be written to. With a preset: <stem>.<preset>.resolved.json, so that it is
/// never taken for the YAML's own.
Result<ResolvedFile> resolve(const ResolveRequest& request);

}  // namespace urgengo::cli
