// SPDX-License-Identifier: Apache-2.0
//
// urgengo: the command line tool. One file a command; this one lists them.
#include <exception>
#include <string>
#include <vector>

#include "tools/bench/commands/bench_commands.h"
#include "tools/urgengo/cmd_bench.h"
#include "tools/urgengo/cmd_check.h"
#include "tools/urgengo/cmd_compare.h"
#include "tools/urgengo/cmd_completion.h"
#include "tools/urgengo/cmd_ctl.h"
#include "tools/urgengo/cmd_discover.h"
#include "tools/urgengo/cmd_doctor.h"
#include "tools/urgengo/cmd_export.h"
#include "tools/urgengo/cmd_profile.h"
#include "tools/urgengo/cmd_report.h"
#include "tools/urgengo/cmd_run.h"
#include "tools/urgengo/cmd_sim.h"
#include "tools/urgengo/cmd_top.h"
#include "tools/urgengo/cmd_trace.h"
#include "tools/urgengo/commands.h"
#include "tools/urgengo/exit_codes.h"

namespace {

/// All commands, those of `urgengo bench` among them.
urgengo::cli::CliCommand whole_tree(const urgengo::cli::Commands& commands) {
    using namespace urgengo::cli;
    CliCommand root = tree_of(commands.app(), "urgengo");
    Commands bench(kBenchDescription, "urgengo bench");
    add_bench_commands(bench);
    for (CliCommand& command : root.commands)
        if (command.word() == "bench") {
            const std::string group = command.group;
            command = tree_of(bench.app(), "urgengo bench");
            command.group = group;
            command.is_hidden = false;
        }
    return root;
}

}  // namespace

int main(int argc, char** argv) {
    using namespace urgengo::cli;
    using Takes = Commands::Takes;
    constexpr char kPrepare[] = "Before a run";
    constexpr char kRun[] = "Run";
    constexpr char kSee[] = "While it runs";
    constexpr char kAfterwards[] = "After a run";
    constexpr char kMeasure[] = "Measure";
    constexpr char kShell[] = "Shell";
    constexpr char kHidden[] = "";  // the build calls it
    try {
        Commands commands("UrgenGo makes unmodified GPU programs meet their deadlines.", "urgengo");
        commands.add(kPrepare, add_doctor, cmd_doctor, Takes::kProgram);
        commands.add(kPrepare, add_discover, cmd_discover, Takes::kProgram);
        commands.add(kPrepare, add_check, cmd_check, Takes::kProgram);
        commands.add(kPrepare, add_profile, cmd_profile, Takes::kProgram);
        commands.add(kRun, add_run, cmd_run, Takes::kProgramOrFails);
        commands.add(
            kSee, add_ctl, [](const CtlOptions& options, const auto&) { return cmd_ctl(options); },
            Takes::kArguments);
        commands.add(
            kSee, add_top, [](const TopCommand& command, const auto&) { return cmd_top(command); },
            Takes::kArguments);
        commands.add(kSee, add_export, cmd_export, Takes::kArguments);
        commands.add(
            kAfterwards, add_report,
            [](const ReportOptions& options, const auto&) { return cmd_report(options); },
            Takes::kArguments);
        commands.add(kMeasure, add_compare, cmd_compare, Takes::kProgram);
        commands.add(
            kAfterwards, add_trace,
            [](const TraceOptions& options, const auto&) { return cmd_trace(options); },
            Takes::kArguments);
        commands.add(kMeasure, add_sim, cmd_sim, Takes::kArguments);
        commands.add(kMeasure, add_bench, cmd_bench, Takes::kRest);
        commands.add(
            kShell, add_completion,
            [&](const CompletionOptions& options, const auto&) {
                return cmd_completion(options, whole_tree(commands));
            },
            Takes::kArguments);
        commands.add(
            kHidden, add_man,
            [&](const ManOptions& options, const auto&) {
                return cmd_man(options, whole_tree(commands));
            },
            Takes::kArguments);
        return commands.dispatch({argv + 1, argv + argc});
    } catch (const std::exception& error) {
        return fail(kExitFailure, error.what());
    }
}
