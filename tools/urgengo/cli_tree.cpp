// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/cli_tree.h"

#include <sstream>

namespace urgengo::cli {
namespace {

/// CLI11 tells of a set of words as "TEXT:{off,on}".
std::vector<std::string> choices_of(const std::string& type) {
    const std::size_t begin = type.find('{'), end = type.find('}');
    std::vector<std::string> choices;
    if (begin == std::string::npos || end == std::string::npos) return choices;
    std::istringstream words(type.substr(begin + 1, end - begin - 1));
    for (std::string word; std::getline(words, word, ',');) choices.push_back(word);
    return choices;
}

CliOption option_of(const CLI::Option& option) {
    CliOption own;
    for (const std::string& name : option.get_snames()) own.names.push_back("-" + name);
    for (const std::string& name : option.get_lnames()) own.names.push_back("--" + name);
    own.is_positional = own.names.empty();
    if (own.is_positional) own.names.push_back(option.get_name(true));
    own.takes_value = option.get_items_expected_max() > 0 && option.get_type_size_max() > 0;
    own.choices = choices_of(option.get_type_name());
    if (own.takes_value) own.value = option.get_type_name();
    if (const std::size_t colon = own.value.find(':'); colon != std::string::npos)
        own.value = own.value.substr(own.choices.empty() ? 0 : colon + 1,
                                     own.choices.empty() ? colon : std::string::npos);
    own.description = option.get_description();
    return own;
}

}  // namespace

CliCommand tree_of(const CLI::App& app, const std::string& name) {
    CliCommand command;
    command.name = name;
    command.group = app.get_group();
    command.is_hidden = command.group.empty();
    command.description = app.get_description();
    command.footer = app.get_footer();
    for (const CLI::Option* option : app.get_options())
        if (!option->get_group().empty()) command.options.push_back(option_of(*option));
    for (const CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; }))
        command.commands.push_back(tree_of(*sub, name + " " + sub->get_name()));
    return command;
}

std::vector<const CliCommand*> flat(const CliCommand& root) {
    std::vector<const CliCommand*> all{&root};
    for (const CliCommand& command : root.commands) {
        if (command.is_hidden) continue;
        const auto below = flat(command);
        all.insert(all.end(), below.begin(), below.end());
    }
    return all;
}

}  // namespace urgengo::cli
