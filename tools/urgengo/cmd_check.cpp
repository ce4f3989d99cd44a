// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/cmd_check.h"

#include <fmt/format.h>

#include <filesystem>
#include <optional>
#include <utility>

#include "host/config/config_reader.h"
#include "tools/discover/claims.h"
#include "tools/urgengo/command_json.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/paths.h"
#include "tools/urgengo/program/trace_program.h"
#include "tools/urgengo/program/traced_run.h"
#include "tools/urgengo/run_findings.h"
#include "tools/urgengo/temporary_folder.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// @returns what is wrong with the options; empty if nothing is
std::string check(const CheckOptions& options, const std::vector<std::string>& program) {
    if (!options.trace.empty() && options.seconds > 0) {
        return "found --seconds with --trace, which runs nothing, accepted: one of them";
    }
    if (options.config.empty() && !fs::exists(kDefaultConfig)) {
        return "no config, accepted: -c FILE, or a chains.yaml in the current folder";
    }
    if (program.empty() && options.trace.empty() && options.stats.empty()) {
        return "no program, accepted: urgengo check [options] -- program [args...], or --trace "
               "FILE of a program that was watched before, or --stats FILE of a run";
    }
    return {};
}

}  // namespace

CLI::App* add_check(CLI::App& app, CheckOptions& options) {
    CLI::App* command = app.add_subcommand("check", "Show what of a program a chains.yaml matches");
    command->footer("After the options: -- program [args...]");
    command->add_option("-c,--config", options.config, "The chains [chains.yaml]");
    command->add_option("--trace", options.trace, "Look at this trace and run nothing");
    command->add_option("--stats", options.stats,
                        "Also tell what of a run under UrgenGo, whose statistics these are, was "
                        "not as the config and profile say");
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
    std::optional<RunFindings> run_findings;
    if (!options.stats.empty()) {
        auto read = read_run_findings(options.stats);
        if (!read) return fail(kExitUsage, read.error());
        run_findings = std::move(*read);
        if (program.empty() && options.trace.empty()) {
            if (options.json)
                print_as_json(Json{{"format_version", 1},
                                   {"config", file},
                                   {"run", run_findings_json(*run_findings)}});
            else
                fmt::print("{}", format_run_findings(*run_findings));
            return 0;
        }
    }
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
    if (options.json) {
        Json json = claims_json(file, claims);
        if (run_findings) json["run"] = run_findings_json(*run_findings);
        print_as_json(json);
    } else {
        fmt::print("{}", discover::format_claims(*config, claims));
        if (run_findings) fmt::print("\n{}", format_run_findings(*run_findings));
    }
    return discover::all_matched(claims) ? 0 : kExitFailure;
}

}  // namespace urgengo::cli
