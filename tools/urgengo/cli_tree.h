// SPDX-License-Identifier: Apache-2.0
//
// What --help tells, as data: for shell completion and man pages, which so cannot go stale.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace urgengo::cli {

struct CliOption {
    std::vector<std::string> names;  ///< "-q", "--quiet"; of a positional its name
    bool is_positional = false;
    bool takes_value = false;
    std::string value;                 ///< "FILE", "{off,on}"; empty: any
    std::vector<std::string> choices;  ///< if only these are accepted
    std::string description;
};

struct CliCommand {
    std::string name;  ///< as typed: "urgengo bench smoke"
    std::string group, description, footer;
    std::vector<CliOption> options;
    std::vector<CliCommand> commands;
    bool is_hidden = false;

    /// @returns the last word
    std::string word() const { return name.substr(name.rfind(' ') + 1); }
};

/// @param name  as typed
CliCommand tree_of(const CLI::App& app, const std::string& name);

/// @returns the command and all below it, hidden ones left out
std::vector<const CliCommand*> flat(const CliCommand& root);

}  // namespace urgengo::cli
