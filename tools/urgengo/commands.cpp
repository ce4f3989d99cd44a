// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/commands.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "tools/urgengo/exit_codes.h"
#include "urgengo_build_info.h"

namespace urgengo::cli {

Commands::Commands(const std::string& description, const std::string& name)
    : app_(description, name) {
    app_.set_version_flag("--version", fmt::format("{} {} ({})", name, kVersion, kCommit));
    app_.require_subcommand(1);
}

void Commands::declare(const std::string& group, CLI::App* app, Takes takes,
                       std::function<int(const std::vector<std::string>&)> run) {
    app->group(group);
    // For a message of our own when "--" is forgotten; and the rest is for another program.
    if (takes != Takes::kArguments) app->allow_extras();
    if (takes == Takes::kRest) app->prefix_command()->set_help_flag();
    if (takes != Takes::kRest) {
        const std::string quiet = "Say on stderr only what went wrong";
        const std::string verbose = "Say on stderr more of what is done";
        if (!app->get_option_no_throw("--quiet")) app->add_flag("-q,--quiet", quiet);
        if (!app->get_option_no_throw("--verbose")) app->add_flag("-v,--verbose", verbose);
    }
    commands_.push_back({app, takes, std::move(run)});
}

std::string Commands::names(const std::function<bool(const Command&)>& which) const {
    std::string names;
    for (const Command& command : commands_) {
        if (!which(command)) continue;
        if (!names.empty()) names += ", ";
        names += app_.get_name() + " " + command.app->get_name();
    }
    return names;
}

int Commands::report(const CLI::ParseError& error) const {
    if (error.get_exit_code() == static_cast<int>(CLI::ExitCodes::Success)) return app_.exit(error);
    // CLI11 says "A subcommand is required", even if there is one that it does not know.
    if (error.get_name() == "RequiredError") {
        return fail(kExitUsage, "no such command, accepted: " + names([](const Command& command) {
                                    return !command.app->get_group().empty();
                                }));
    }
    return fail(kExitUsage, fmt::format("{} ({} --help lists what is accepted)", error.what(),
                                        app_.get_name()));
}

int Commands::dispatch(const std::vector<std::string>& arguments) {
    // The program's own arguments are none of the parser's business.
    const auto separator = std::find(arguments.begin(), arguments.end(), "--");
    const bool has_separator = separator != arguments.end();
    const std::vector<std::string> program(has_separator ? separator + 1 : separator,
                                           arguments.end());
    std::vector<std::string> own(arguments.begin(), separator);
    std::reverse(own.begin(), own.end());  // CLI11 takes arguments from the back
    try {
        app_.parse(own);
    } catch (const CLI::ParseError& error) {
        return report(error);
    }
    for (const Command& command : commands_) {
        if (command.app->parsed()) return call(command, arguments, program, has_separator);
    }
    return kExitUsage;
}

int Commands::call(const Command& command, const std::vector<std::string>& arguments,
                   const std::vector<std::string>& program, bool has_separator) const {
    if (command.takes == Takes::kRest) {
        const auto name = std::find(arguments.begin(), arguments.end(), command.app->get_name());
        return command.run({name + 1, arguments.end()});
    }
    if (command.app->count("--quiet") > 0)
        tools::set_log_level(tools::LogLevel::kError);
    else if (command.app->count("--verbose") > 0)
        tools::set_log_level(tools::LogLevel::kDebug);
    if (command.takes == Takes::kArguments) {
        if (!has_separator) return command.run(arguments);
        const std::string takers = names([](const Command& other) {
            return other.takes == Takes::kProgram || other.takes == Takes::kProgramOrFails;
        });
        return fail(kExitUsage,
                    "found '--', accepted: " + (takers.empty() ? "none" : "only after " + takers));
    }
    const std::string usage = fmt::format("accepted: {} {} [options] -- program [args...]",
                                          app_.get_name(), command.app->get_name());
    const std::vector<std::string> extras = command.app->remaining();
    if (!extras.empty()) {
        return fail(
            kExitUsage,
            fmt::format("{}'{}', {}", extras[0].starts_with("-") ? "unknown option " : "found ",
                        extras[0], usage));
    }
    if (command.takes == Takes::kProgramOrFails && program.empty()) {
        return fail(kExitUsage, "no program, " + usage);
    }
    return command.run(program);
}

}  // namespace urgengo::cli
