// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/cmd_check.h"

#include <fmt/format.h>

#include <filesystem>

#include "host/config/config_reader.h"
#include "tools/discover/claims.h"
#include "tools/urgengo/command_json.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/paths.h"
#include "tools/urgengo/program/trace_program.h"
#include "tools/urgengo/program/traced_run.h"
#include "tools/urgengo/temporary_folder.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;

/// @returns what is wrong with the options; empty if nothing is
std::string check(const CheckOptions& options, const std::vector<std::string>& program) {
    if (!options.trace.empty() && options.seconds > 0) {
        return "found --seconds with --trace, which runs nothing, accepted: one of them";
    }
    if (options.config.empty() && !fs::exists(kDefaultConfig)) {
        return "no config, accepted: -c FILE, or a chains.yaml in the current folder";
    }
    if (program.empty() && options.trace.empty()) {
        return "no program, accepted: urgengo check [options] -- program [args...], or --trace "
               "FILE of a program that was watched before";
    }
    return {};
}

}  // namespace

CLI::App* add_check(CLI::App& app, CheckOptions& options) {
    CLI::App* command = app.add_subcommand("check", "Show what of a program a chains.yaml matches");
    command->footer("After the options: -- program [args...]");
    command->add_option("-c,--config", options.config, "The chains [chains.yaml]");
    command->add_option("--trace", options.trace, "Look at this trace and run nothing");
    command->add_flag("--json", options.json, "Print JSON; what the program prints goes to stderr");
    add_traced_run_options(*command, options.seconds, options.real_libcuda);
    return command;
}

int cmd_check(const CheckOptions& options, const std::vector<std::string>& program) {
    const std::string wrong = check(options, program);
    if (!wrong.empty()) return fail(kExitUsage, wrong);
    const std::string file = options.config.empty() ? kDefaultConfig : options.config;
    const auto config = config::read_config(file);
    if (!config) return fail(kExitUsage, config.error());
    const auto folder = TemporaryFolder::make();
    if (!folder) return fail(kExitFailure, folder.error());

    const std::string path =
        options.trace.empty() ? (*folder)->path() + "/run.ugtrace" : options.trace;
    if (options.trace.empty()) {
        const Environment environment = current_environment();
        const ProgramSetup setup = set_up_program(program, options.real_libcuda, environment);
        if (setup.exit_code != 0) return fail(setup.exit_code, setup.message);
        warn(setup.warnings);
        config::Config watched = *config;
        watched.mode = config::Mode::kObserve;
        const auto run = trace_program(setup, program, environment, watched, (*folder)->path(),
                                       path, options.seconds, options.json);
        if (!run) return fail(kExitFailure, run.error());
        if (run->exit_code != 0) {
            warn({fmt::format("{}: {}; this is about what it did until then", program[0],
                              run->how)});
        }
    }
    const auto trace = trace::read_trace(path);
    if (!trace) return fail(kExitFailure, trace.error());
    warn(trace->warnings());
    const auto seen = discover::observe(*trace, trace::TaskMatcher(*config, *trace));
    const discover::Claims claims = discover::find_claims(*config, seen);
    if (options.json)
        print_as_json(claims_json(file, claims));
    else
        fmt::print("{}", discover::format_claims(*config, claims));
    return discover::all_matched(claims) ? 0 : kExitFailure;
}

}  // namespace urgengo::cli
