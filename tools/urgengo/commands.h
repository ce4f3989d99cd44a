// SPDX-License-Identifier: Apache-2.0
//
// The sub-commands of one program: parses, says in one line what is wrong, and calls the one that
// was asked for. Their options and help are CLI11's.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace urgengo::cli {

class Commands {
  public:
    /// What a command is called with beside its options.
    enum class Takes {
        kArguments,       ///< all of the program's own arguments, for the record
        kProgram,         ///< what stands behind "--", perhaps nothing
        kProgramOrFails,  ///< what stands behind "--": at least one word
        kRest,            ///< whatever follows its name, which another program reads
    };

    /// @param name  as the user calls the program
    Commands(const std::string& description, const std::string& name);

    /// @param declaration  declares the command and its options: (CLI::App&, Options&) -> CLI::App*
    /// @param run  (Options, what it takes) -> exit status
    template <typename Options, typename Run>
    void add(const std::string& group, CLI::App* (*declaration)(CLI::App&, Options&), Run run,
             Takes takes) {
        const auto options = std::make_shared<Options>();
        CLI::App* const app = declaration(app_, *options);
        declare(group, app, takes, [options, run](const std::vector<std::string>& words) {
            return run(*options, words);
        });
    }

    const CLI::App& app() const { return app_; }

    /// @param arguments  without the program's name
    /// @returns the exit status
    int dispatch(const std::vector<std::string>& arguments);

  private:
    struct Command {
        CLI::App* app;
        Takes takes;
        std::function<int(const std::vector<std::string>&)> run;
    };

    void declare(const std::string& group, CLI::App* app, Takes takes,
                 std::function<int(const std::vector<std::string>&)> run);
    int call(const Command& command, const std::vector<std::string>& arguments,
             const std::vector<std::string>& program, bool has_separator) const;
    int report(const CLI::ParseError& error) const;
    /// @returns "urgengo run, urgengo sim"
    std::string names(const std::function<bool(const Command&)>& which) const;

    CLI::App app_;
    std::vector<Command> commands_;
};

}  // namespace urgengo::cli
