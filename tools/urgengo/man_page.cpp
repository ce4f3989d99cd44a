// SPDX-License-Identifier: Apache-2.0
//
// roff, with the macros of man(7) alone.
#include "tools/urgengo/man_page.h"

#include <fmt/format.h>

#include <algorithm>

namespace urgengo::cli {
namespace {

/// A line that begins with a dot or a quote would be a request.
std::string roff(const std::string& text) {
    std::string own;
    bool begins = true;
    for (const char c : text) {
        if (begins && (c == '.' || c == '\'')) own += "\\&";
        if (c == '\\')
            own += "\\e";
        else if (c == '-')
            own += "\\-";
        else
            own += c;
        begins = c == '\n';
    }
    return own;
}

std::string as_sentence(const std::string& text) {
    return text.ends_with('.') ? text : text + '.';
}

std::string page_name(const CliCommand& command) {
    std::string name = command.name;
    std::replace(name.begin(), name.end(), ' ', '-');
    return name;
}

std::string options(const CliCommand& command) {
    std::string text;
    for (const CliOption& option : command.options) {
        std::string names;
        for (const std::string& name : option.names)
            names += (names.empty() ? "" : ", ") + fmt::format("\\fB{}\\fR", roff(name));
        text +=
            fmt::format(".TP\n{}{}\n{}\n", names,
                        option.value.empty() ? "" : fmt::format(" \\fI{}\\fR", roff(option.value)),
                        roff(option.description));
    }
    return text.empty() ? "" : ".SH OPTIONS\n" + text;
}

std::string commands(const CliCommand& command) {
    std::string text, group;
    for (const CliCommand& sub : command.commands) {
        if (sub.is_hidden) continue;
        if (sub.group != group) text += fmt::format(".SS {}\n", roff(sub.group));
        group = sub.group;
        text += fmt::format(".TP\n\\fB{}\\fR\n{} See \\fB{}\\fR(1).\n", roff(sub.word()),
                            roff(as_sentence(sub.description)), roff(page_name(sub)));
    }
    return text.empty() ? "" : ".SH COMMANDS\n" + text;
}

}  // namespace

std::string man_page_file(const CliCommand& command) {
    return page_name(command) + ".1";
}

std::string man_page(const CliCommand& command, const std::string& version) {
    std::string title = page_name(command), synopsis;
    std::transform(title.begin(), title.end(), title.begin(),
                   [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
    for (const CliOption& option : command.options)
        if (option.is_positional) synopsis += " \\fI" + roff(option.names.front()) + "\\fR";
    if (!command.commands.empty()) synopsis += " \\fIcommand\\fR";
    if (command.footer.find("-- program") != std::string::npos)
        synopsis += roff(" [-- program [args...]]");
    std::string text =
        fmt::format(".TH {} 1 \"\" \"{}\" \"UrgenGo\"\n.SH NAME\n{} \\- {}\n", roff(title),
                    roff(version), roff(page_name(command)), roff(command.description));
    text += fmt::format(".SH SYNOPSIS\n\\fB{}\\fR [options]{}\n", roff(command.name), synopsis);
    text += commands(command) + options(command);
    if (!command.footer.empty()) text += ".SH NOTES\n.nf\n" + roff(command.footer) + "\n.fi\n";
    return text;
}

}  // namespace urgengo::cli
