// SPDX-License-Identifier: Apache-2.0
//
// Completion and man pages tell all that --help tells.
#include <regex>
#include <set>

#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

Outcome urgengo_says(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), URGENGO_PATH);
    return run(arguments, {{"PATH", "/usr/bin:/bin"}});
}

/// @returns options, at the begin of a line of --help
std::set<std::string> options_of(const std::string& help) {
    std::set<std::string> options;
    const std::regex line("  (-\\w,)?(--[\\w-]+)(,(--[\\w-]+))?.*");
    for (const std::string& text : lines_of(help)) {
        std::smatch match;
        if (!std::regex_match(text, match, line)) continue;
        options.insert(match[2]);
        if (match[4].matched) options.insert(match[4]);
    }
    return options;
}

/// @returns commands, which stand below their groups' titles
std::vector<std::string> commands_of(const std::string& help) {
    std::vector<std::string> commands;
    const std::regex line("  ([a-z]+)  +.*");
    for (const std::string& text : lines_of(help))
        if (std::smatch match; std::regex_match(text, match, line)) commands.push_back(match[1]);
    return commands;
}

/// @returns what bash offers behind these words
std::set<std::string> offered(const std::string& script, const std::vector<std::string>& words) {
    std::string line;
    for (const std::string& word : words) line += " '" + word + "'";
    const Outcome outcome = run({"/bin/bash", "-c",
                                 "source " + script + "; COMP_WORDS=(" + line +
                                     "); COMP_CWORD=" + std::to_string(words.size() - 1) +
                                     "; _urgengo; printf '%s\\n' \"${COMPREPLY[@]}\""},
                                {{"PATH", "/usr/bin:/bin"}});
    CHECK(outcome.err == "");
    const auto lines = lines_of(outcome.out);
    return {lines.begin(), lines.end()};
}

}  // namespace

TEST_CASE("Completion and man pages have every command and option of --help",
          "[interposer][completion]") {
    const Folder folder;
    const std::string script = folder.path("urgengo.bash");
    const Outcome bash = urgengo_says({"completion", "bash"});
    REQUIRE(bash.exit_status == 0);
    write_text(script, bash.out);
    const std::string zsh = urgengo_says({"completion", "zsh"}).out;
    const std::string fish = urgengo_says({"completion", "fish"}).out;
    REQUIRE(urgengo_says({"man", folder.path("man")}).exit_status == 0);

    const auto check = [&](const std::vector<std::string>& words) {
        std::vector<std::string> help = words, line = words;
        help.emplace_back("--help");
        line.insert(line.begin(), "urgengo");
        std::string name, file;
        for (const std::string& word : line) {
            name += (name.empty() ? "" : " ") + word;
            file += (file.empty() ? "" : "-") + word;
        }
        const Outcome shown = urgengo_says(help);
        REQUIRE(shown.exit_status == 0);
        const std::string page = read_text(folder.path("man/" + file + ".1"));
        line.emplace_back("-");
        const auto words_offered = offered(script, line);
        const auto options = options_of(shown.out);
        CHECK(options.count("--help") == 1);
        for (const std::string& option : options) {
            INFO(name << " " << option);
            CHECK(words_offered.count(option) == 1);
            CHECK(page.find(std::regex_replace(option, std::regex("-"), "\\-")) !=
                  std::string::npos);
            CHECK(zsh.find("'" + option + ":") != std::string::npos);
            CHECK(fish.find("_at " + name + "'") != std::string::npos);
            CHECK(fish.find(" -l " + option.substr(2) + " ") != std::string::npos);
        }
        CHECK(words_offered.size() >= options.size());
        return commands_of(shown.out);
    };
    const auto commands = check({});
    CHECK(commands.size() > 10);
    const auto offered_commands = offered(script, {"urgengo", ""});
    for (const std::string& command : commands) {
        CHECK(offered_commands.count(command) == 1);
        for (const std::string& sub : check({command})) check({command, sub});
    }
}

TEST_CASE("Completion offers an option's values, and leaves the program's words alone",
          "[interposer][completion]") {
    const Folder folder;
    const std::string script = folder.path("urgengo.bash");
    write_text(script, urgengo_says({"completion", "bash"}).out);
    CHECK(offered(script, {"urgengo", "top", "--sort", "p"}) == std::set<std::string>{"p99"});
    CHECK(offered(script, {"urgengo", "ctl", "ob"}) == std::set<std::string>{"observe"});
    CHECK(offered(script, {"urgengo", "bench", "sm"}) == std::set<std::string>{"smoke"});
    CHECK(offered(script, {"urgengo", "man"}) != std::set<std::string>{"man"});  // not for users
    const auto programs = offered(script, {"urgengo", "run", "--", "bas"});
    CHECK(programs.count("bash") == 1);
    CHECK(urgengo_says({"completion", "tcsh"}).exit_status == 2);
}
