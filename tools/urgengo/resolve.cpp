// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/resolve.h"

#include <fmt/format.h>

#include <filesystem>
#include <optional>

#include "host/base/atomic_file.h"
#include "host/base/hash.h"
#include "host/config/config_reader.h"
#include "host/config/file_text.h"
#include "host/config/profile_reader.h"
#include "host/config/resolved_config.h"
#include "tools/urgengo/temporary_folder.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;

/// @returns the name by which a resolved file in `folder` finds the source
std::string name_from(const fs::path& folder, const fs::path& source) {
    return source.parent_path() == folder ? source.filename().string() : source.string();
}

std::string file_name(const fs::path& yaml, const std::string& preset) {
    return yaml.stem().string() + (preset.empty() ? "" : "." + preset) + ".resolved.json";
}

/// Everything that goes into the resolved file but the folder that it will lie in.
struct Sources {
    fs::path yaml;  // absolute, as is profile_path
    std::uint64_t yaml_hash = 0;
    config::Config config;
    fs::path profile_path;
    std::uint64_t profile_hash = 0;
    std::optional<config::Profile> profile;
};

Result<Sources> read_sources(const ResolveRequest& request) {
    Sources sources;
    // Hash and parse the same bytes, or a file edited meanwhile would pass for the one that was
    // read.
    const auto yaml_text = config::read_file(request.yaml);
    if (!yaml_text) return Error{yaml_text.error()};
    auto config = config::parse_config(*yaml_text, request.yaml, request.preset);
    if (!config) return Error{config.error()};
    sources.yaml = fs::absolute(request.yaml).lexically_normal();
    sources.yaml_hash = fnv1a64(*yaml_text);
    sources.config = std::move(*config);

    std::string profile_path = request.profile;
    if (profile_path.empty()) {
        profile_path = config::profile_sibling(request.yaml);
        if (!fs::exists(profile_path)) return sources;
    }
    const auto profile_text = config::read_file(profile_path);
    if (!profile_text) return Error{profile_text.error()};
    auto profile = config::parse_profile(*profile_text, profile_path);
    if (!profile) return Error{profile.error()};
    sources.profile_path = fs::absolute(profile_path).lexically_normal();
    sources.profile_hash = fnv1a64(*profile_text);
    sources.profile = std::move(*profile);
    return sources;
}

/// @returns why the profile is refused, one line; empty if it is not
std::string check_profile(const ResolveRequest& request, const Sources& sources,
                          std::vector<std::string>& warnings) {
    if (!sources.profile || !request.target) return {};
    const config::ProfileMatch match = profile_matches(*sources.profile, request.target());
    const std::string prefix = sources.profile_path.string() + ": ";
    for (const std::string& text : match.warnings) warnings.push_back(prefix + text);
    if (match.refusals.empty()) return {};
    if (!request.allow_stale) {
        return prefix + fmt::format("{}", fmt::join(match.refusals, "; ")) +
               " (profile again, or use it all the same: --allow-stale)";
    }
    for (const std::string& text : match.refusals) warnings.push_back(prefix + text);
    return {};
}

Result<bool> write_into(const fs::path& folder, const std::string& name, const Sources& sources) {
    config::SourceStamp stamp = {{name_from(folder, sources.yaml), sources.yaml_hash}};
    if (sources.profile) {
        stamp.push_back({name_from(folder, sources.profile_path), sources.profile_hash});
    }
    const config::Profile* profile = sources.profile ? &*sources.profile : nullptr;
    return write_file_atomically((folder / name).string(),
                                 config::to_resolved_json(sources.config, profile, stamp));
}

/// @returns the path of the file written
Result<std::string> write_resolved(const Sources& sources, const std::string& preset) {
    const fs::path beside = sources.yaml.parent_path();
    const std::string name = file_name(sources.yaml, preset);
    const auto written_beside = write_into(beside, name, sources);
    if (written_beside) return (beside / name).string();

    const auto session = session_folder();
    if (!session) return Error{written_beside.error() + "; " + session.error()};
    // Several YAML files of one name share the session's folder.
    const std::string unique = fmt::format("{:016x}-{}", fnv1a64(sources.yaml.string()), name);
    const auto written = write_into(*session, unique, sources);
    if (!written) return Error{written_beside.error() + "; " + written.error()};
    return (fs::path(*session) / unique).string();
}

}  // namespace

Result<ResolvedFile> resolve(const ResolveRequest& request) {
    auto sources = read_sources(request);
    if (!sources) return Error{sources.error()};
    ResolvedFile resolved{sources->config, "", {}};
    if (sources->profile) {
        resolved.warnings = config::profile_warnings(sources->config, *sources->profile);
    }
    const std::string refusal = check_profile(request, *sources, resolved.warnings);
    if (!refusal.empty()) return Error{refusal};
    if (sources->config.scheduler.priority.via == config::PriorityVia::kAuto &&
        request.priority_via) {
        sources->config.scheduler.priority.via = request.priority_via(sources->config);
        resolved.config = sources->config;
    }
    auto path = write_resolved(*sources, request.preset);
    if (!path) return Error{path.error()};
    resolved.path = *path;
    return resolved;
}

}  // namespace urgengo::cli
