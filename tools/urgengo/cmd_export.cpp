// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/cmd_export.h"

#include <fmt/format.h>
#include <unistd.h>

#include <charconv>
#include <cstring>

#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/paths.h"

namespace urgengo::cli {

Result<ListenAddress> parse_address(const std::string& text) {
    const Error wrong{
        fmt::format("--listen: found '{}', accepted: ADDRESS:PORT, with [] around an IPv6 address, "
                    "or :PORT for all addresses",
                    text)};
    const std::size_t colon = text.rfind(':');
    if (colon == std::string::npos) return wrong;
    ListenAddress address{text.substr(0, colon), text.substr(colon + 1)};
    std::uint16_t port = 0;
    const char* const end = address.port.data() + address.port.size();
    const auto [last, error] = std::from_chars(address.port.data(), end, port);
    if (error != std::errc{} || last != end) return wrong;
    std::string& host = address.host;
    const bool has_brackets = host.size() > 2 && host.front() == '[' && host.back() == ']';
    if (has_brackets) host = host.substr(1, host.size() - 2);
    if (host.empty()) host = "0.0.0.0";
    const bool is_v6 = host.find(':') != std::string::npos;
    if (is_v6 != has_brackets || host.find_first_not_of("0123456789abcdefABCDEF.:") != host.npos)
        return wrong;
    return address;
}

CLI::App* add_export(CLI::App& app, ExportOptions& options) {
    CLI::App* command = app.add_subcommand("export", "Serve metrics for Prometheus");
    command->footer("GET /metrics. Ends with Ctrl-C.");
    command
        ->add_option("--listen", options.listen,
                     fmt::format("Address and port; port 0: any [{}]", kDefaultListen))
        ->check([](const std::string& text) {
            const auto address = parse_address(text);
            return address ? std::string{} : address.error();
        });
    command->add_option("--pid", options.pid, "One process; else all that this user may look at")
        ->check(CLI::PositiveNumber);
    command->add_flag("--once", options.once, "Print what there is now, and end");
    command->add_flag("-q,--quiet", options.quiet, "Do not say what is served");
    return command;
}

int cmd_export(const ExportOptions&, const std::vector<std::string>& arguments) {
    const auto program = export_program();
    if (!program) return fail(kExitNotFound, program.error());
    std::vector<char*> words = {const_cast<char*>(program->c_str())};
    for (const std::string& argument : arguments)
        words.push_back(const_cast<char*>(argument.c_str()));
    words.push_back(nullptr);
    execv(program->c_str(), words.data());
    return fail(kExitNotExecutable, *program + ": " + std::strerror(errno));
}

}  // namespace urgengo::cli
