// SPDX-License-Identifier: Apache-2.0
//
// The resolved config: one JSON file with the validated config, the profile, and the hashes of the
// files that both came from. The CLI writes it; the interposer reads it, inside the user's
// program, so nothing here throws, prints, or depends on the process' locale.
//
// It lies beside its YAML as <stem>.resolved.json. Given the YAML itself, the interposer uses that
// sibling only while the recorded hashes are those of the files as they are now.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "host/base/result.h"
#include "host/config/config.h"
#include "host/config/file_text.h"

namespace urgengo::config {

struct SourceFile {
    std::string path;        ///< absolute, or relative to the resolved file's folder
    std::uint64_t hash = 0;  ///< fnv1a64 of its contents
};

/// The YAML, and the profile if there is one.
using SourceStamp = std::vector<SourceFile>;

struct ResolvedConfig {
    Config config;
    std::optional<Profile> profile;
    SourceStamp source;
    bool mode_is_asked = false;  ///< config.mode is what the user asked for, not the file's
};

/// @param config   without chains only if it observes: `urgengo discover` knows of none yet
/// @param profile  may be null
std::string to_resolved_json(const Config& config, const Profile* profile,
                             const SourceStamp& source);

/// @param file_name_for_errors  what error messages call the text
/// @errors file, JSON path (line and column for a syntax error), found, accepted; never throws
Result<ResolvedConfig> parse_resolved_json(std::string_view text,
                                           const std::string& file_name_for_errors);

using ReadFile = std::function<Result<std::string>(const std::string& path)>;

/// Reads what URGENGO_CONFIG names: a resolved .json, or a .yaml/.yml with an up-to-date resolved
/// sibling.
/// @param read  of the resolved file
/// @errors one line; for a missing or stale sibling, the command that writes it; never throws
Result<ResolvedConfig> load_for_interposer(const std::string& path,
                                           const ReadFile& read = read_file);

/// @returns "dir/chains.resolved.json" for "dir/chains.yaml"
std::string resolved_sibling(const std::string& yaml_path);
/// @returns "dir/chains.profile.json" for "dir/chains.yaml"
std::string profile_sibling(const std::string& yaml_path);

}  // namespace urgengo::config
