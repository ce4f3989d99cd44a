// SPDX-License-Identifier: Apache-2.0
//
// All three scripts go the same way: the words so far say which command it is ("urgengo bench
// smoke"); the word before the cursor may be an option that takes a value; else the command's
// options and commands are offered. What stands behind "--" is another program.
#include "tools/urgengo/completion.h"

#include <fmt/format.h>

#include <functional>

namespace urgengo::cli {
namespace {

/// For a shell, in single quotes. @param quote  how a quote is written there
std::string shell_quoted(const std::string& text, const char* quote = "'\\''") {
    std::string own = "'";
    for (const char c : text)
        if (c == '\'')
            own += quote;
        else
            own += c == '\n' ? ' ' : c;
    return own + "'";
}

/// Words that may follow the command, with what they mean.
void each_word(const CliCommand& command,
               const std::function<void(const std::string&, const std::string&)>& call) {
    for (const CliCommand& sub : command.commands)
        if (!sub.is_hidden) call(sub.word(), sub.description);
    for (const CliOption& option : command.options) {
        if (option.is_positional)
            for (const std::string& choice : option.choices) call(choice, option.description);
        else
            for (const std::string& name : option.names) call(name, option.description);
    }
}

/// "'urgengo run' | 'urgengo top'", or with another separator
std::string names_below(const CliCommand& root, const char* separator) {
    std::string names;
    for (const CliCommand* command : flat(root))
        if (command != &root)
            names += (names.empty() ? "" : separator) + shell_quoted(command->name);
    return names;
}

/// Lines of a case: what an option's value may be.
std::string values(const CliCommand& root, const char* choices, const char* files) {
    std::string lines;
    for (const CliCommand* command : flat(root))
        for (const CliOption& option : command->options) {
            if (option.is_positional || !option.takes_value) continue;
            std::string patterns, words;
            for (const std::string& name : option.names)
                patterns +=
                    (patterns.empty() ? "" : " | ") + shell_quoted(command->name + " " + name);
            for (const std::string& choice : option.choices)
                words += (words.empty() ? "" : " ") + choice;
            lines += words.empty() ? fmt::format("        {}) {} ;;\n", patterns, files)
                                   : fmt::format("        {}) {} ;;\n", patterns,
                                                 fmt::format(fmt::runtime(choices), words));
        }
    return lines;
}

}  // namespace

std::string bash_completion(const CliCommand& root) {
    std::string cases;
    for (const CliCommand* command : flat(root)) {
        std::string words;
        each_word(*command, [&](const std::string& word, const std::string&) {
            words += (words.empty() ? "" : " ") + word;
        });
        cases += fmt::format("        {}) words={} ;;\n", shell_quoted(command->name),
                             shell_quoted(words));
    }
    return fmt::format(
        R"(# bash completion for {0}: made by `{0} completion bash`
_{0}() {{
    local cur=${{COMP_WORDS[COMP_CWORD]}} prev=${{COMP_WORDS[COMP_CWORD - 1]}} at={0} words= i
    COMPREPLY=()
    for ((i = 1; i < COMP_CWORD; ++i)); do
        if [ "${{COMP_WORDS[i]}}" = -- ]; then
            if declare -F _command_offset >/dev/null; then
                _command_offset $((i + 1))
            else
                mapfile -t COMPREPLY < <(compgen -c -- "$cur")
            fi
            return
        fi
        case "$at ${{COMP_WORDS[i]}}" in
            {1}) at="$at ${{COMP_WORDS[i]}}" ;;
        esac
    done
    case "$at $prev" in
{2}    esac
    case "$at" in
{3}    esac
    mapfile -t COMPREPLY < <(compgen -W "$words" -- "$cur")
}}
complete -o default -F _{0} {0}
)",
        root.name, names_below(root, " | "),
        values(root, R"(mapfile -t COMPREPLY < <(compgen -W '{}' -- "$cur"); return)",
               R"(mapfile -t COMPREPLY < <(compgen -f -- "$cur"); return)"),
        cases);
}

std::string zsh_completion(const CliCommand& root) {
    const auto escaped = [](const std::string& text) {
        std::string own;
        for (const char c : text) own += c == ':' ? std::string("\\:") : std::string(1, c);
        return own;
    };
    std::string cases;
    for (const CliCommand* command : flat(root)) {
        std::string words;
        each_word(*command, [&](const std::string& word, const std::string& description) {
            words += "\n            " + shell_quoted(word + ":" + escaped(description));
        });
        cases += fmt::format("        {}) entries=({}) ;;\n", shell_quoted(command->name), words);
    }
    return fmt::format(
        R"(#compdef {0}
# zsh completion for {0}: made by `{0} completion zsh`
_{0}() {{
    local at={0} word i
    local -a entries
    for ((i = 2; i < CURRENT; ++i)); do
        word=$words[i]
        if [[ $word == -- ]]; then
            shift $i words
            ((CURRENT -= i))
            _normal
            return
        fi
        case "$at $word" in
            {1}) at="$at $word" ;;
        esac
    done
    case "$at $words[CURRENT-1]" in
{2}    esac
    case "$at" in
{3}    esac
    _describe -o 'words' entries || _files
}}
_{0} "$@"
)",
        root.name, names_below(root, " | "), values(root, "compadd {}; return", "_files; return"),
        cases);
}

std::string fish_completion(const CliCommand& root) {
    const auto in_fish = [](const std::string& text) { return shell_quoted(text, "\\'"); };
    std::string lines;
    for (const CliCommand* command : flat(root)) {
        const std::string head = fmt::format("complete -c {} -n {}", root.name,
                                             in_fish("__" + root.name + "_at " + command->name));
        for (const CliCommand& sub : command->commands)
            if (!sub.is_hidden)
                lines +=
                    fmt::format("{} -f -a {} -d {}\n", head, sub.word(), in_fish(sub.description));
        for (const CliOption& option : command->options) {
            std::string choices, names;
            for (const std::string& choice : option.choices)
                choices += (choices.empty() ? "" : " ") + choice;
            if (!option.is_positional)
                for (const std::string& name : option.names)
                    names +=
                        name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1);
            if (option.is_positional && choices.empty()) continue;
            lines += fmt::format("{}{}{}{} -d {}\n", head, names,
                                 choices.empty() ? "" : " -f -a " + in_fish(choices),
                                 option.takes_value && !option.is_positional ? " -r" : "",
                                 in_fish(option.description));
        }
    }
    return fmt::format(
        R"(# fish completion for {0}: made by `{0} completion fish`
function __{0}_at
    set -l at {0}
    for word in (commandline -opc)[2..-1]
        if test "$word" = --
            return 1
        end
        if contains -- "$at $word" {1}
            set at "$at $word"
        end
    end
    test "$at" = "$argv"
end
{2})",
        root.name, names_below(root, " "), lines);
}

}  // namespace urgengo::cli
