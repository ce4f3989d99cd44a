// SPDX-License-Identifier: Apache-2.0
//
// urgengo-chains: ten chains of tasks that share a GPU, after the paper's evaluation. An ordinary
// CUDA program: it schedules nothing, and knows of UrgenGo only the optional hints.
#include <exception>

#include <fmt/format.h>

#include "tools/chains/cmd.h"
#include "tools/log/log.h"
#include "tools/results.h"
#include "urgengo_build_info.h"

int main(int argc, char** argv) {
    using namespace urgengo::chains;
    const std::string command_line = urgengo::command_line_for_results({argv, argv + argc});

    urgengo::tools::set_log_name("urgengo-chains");
    int exit_code = 0;
    CLI::App app("Ten task chains on one GPU: calibrate, then run, bare or under UrgenGo");
    app.set_version_flag(
        "--version", fmt::format("urgengo-chains {} ({})", urgengo::kVersion, urgengo::kCommit));
    app.require_subcommand(1);
    add_calibrate(app);
    add_run(app, command_line, exit_code);
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        return app.exit(error) == 0 ? 0 : kExitFailure;
    } catch (const std::exception& error) {
        urgengo::tools::log_error("{}", error.what());
        return kExitFailure;
    }
    return exit_code;
}
