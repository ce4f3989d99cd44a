// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/cmd_completion.h"

#include <fmt/format.h>

#include <filesystem>

#include "host/base/atomic_file.h"
#include "tools/urgengo/completion.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/man_page.h"
#include "urgengo_build_info.h"

namespace urgengo::cli {

CLI::App* add_completion(CLI::App& app, CompletionOptions& options) {
    CLI::App* command =
        app.add_subcommand("completion", "Print what makes a shell complete command lines");
    command->footer(
        "bash: source <(urgengo completion bash)\n"
        "zsh: urgengo completion zsh >_urgengo in a folder of $fpath\n"
        "fish: urgengo completion fish | source");
    command->add_option("shell", options.shell, "bash, zsh or fish")
        ->required()
        ->check(CLI::IsMember({"bash", "zsh", "fish"}));
    return command;
}

int cmd_completion(const CompletionOptions& options, const CliCommand& root) {
    fmt::print("{}", options.shell == "bash"  ? bash_completion(root)
                     : options.shell == "zsh" ? zsh_completion(root)
                                              : fish_completion(root));
    return 0;
}

CLI::App* add_man(CLI::App& app, ManOptions& options) {
    CLI::App* command = app.add_subcommand("man", "Write the man pages");
    command->add_option("folder", options.folder, "Where to")->required();
    return command;
}

int cmd_man(const ManOptions& options, const CliCommand& root) {
    std::error_code error;
    std::filesystem::create_directories(options.folder, error);
    for (const CliCommand* command : flat(root)) {
        const std::string file = options.folder + "/" + man_page_file(*command);
        const auto written =
            write_file_atomically(file, man_page(*command, fmt::format("urgengo {}", kVersion)));
        if (!written) return fail(kExitFailure, written.error());
    }
    return 0;
}

}  // namespace urgengo::cli
