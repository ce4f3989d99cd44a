// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/cmd_discover.h"

#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <sstream>

#include "host/base/atomic_file.h"
#include "host/config/config_reader.h"
#include "tools/discover/draft.h"
#include "tools/log/log.h"
#include "tools/urgengo/command_json.h"
#include "tools/urgengo/doctor/gpu_probe.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/program/environment_check.h"
#include "tools/urgengo/program/run_process.h"
#include "tools/urgengo/program/trace_program.h"
#include "tools/urgengo/program/traced_run.h"
#include "tools/urgengo/temporary_folder.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;

/// @returns what is wrong with the options; empty if nothing is
std::string check(const DiscoverOptions& options, const std::vector<std::string>& program) {
    if (!options.trace.empty() && (options.seconds > 0 || options.keep_trace)) {
        return fmt::format("found {} with --trace, which runs nothing, accepted: one of them",
                           options.seconds > 0 ? "--seconds" : "--keep-trace");
    }
    if (program.empty() && options.trace.empty()) {
        return "no program, accepted: urgengo discover [options] -- program [args...], or --trace "
               "FILE of a program that was watched before";
    }
    if (fs::exists(options.output) && !options.force) {
        return options.output +
               ": found a file, accepted: another name (-o FILE), or --force to replace it";
    }
    const std::string reason = why_not_writable(options.output);
    if (!reason.empty()) {
        return "-o: found '" + options.output + "', accepted: a file that can be written (" +
               reason + ")";
    }
    return {};
}

/// Runs the program. @returns an exit code; 0: there is a trace
int watch(const DiscoverOptions& options, const std::vector<std::string>& program,
          const std::string& folder, const std::string& trace) {
    const Environment environment = current_environment();
    const ProgramSetup setup = set_up_program(program, options.real_libcuda, environment);
    if (setup.exit_code != 0) return fail(setup.exit_code, setup.message);
    warn(setup.warnings);
    const GpuProbe gpu = probe_gpu(setup.real_libcuda);
    if (!gpu.found) {
        return fail(kExitFailure,
                    "found no GPU, accepted: one that the driver can use (" + gpu.problem + ")");
    }
    config::Config nothing_known;
    nothing_known.mode = config::Mode::kObserve;
    const auto run = trace_program(setup, program, environment, nothing_known, folder, trace,
                                   options.seconds, options.json);
    if (!run) return fail(kExitFailure, run.error());
    if (run->exit_code != 0) {
        warn({fmt::format("{}: {}; the draft is of what it did until then", program[0], run->how)});
    }
    return 0;
}

int write(const DiscoverOptions& options, const discover::Draft& draft,
          const discover::Activities& activities) {
    const auto config = config::parse_config(draft.yaml, options.output);
    if (!config) return fail(kExitFailure, "the draft is not valid, a bug: " + config.error());
    const auto written = write_file_atomically(options.output, draft.yaml);
    if (!written) return fail(kExitFailure, written.error());
    if (options.json) print_as_json(draft_json(options.output, *config, draft, activities));
    std::string names;
    for (const discover::DraftChain& chain : draft.chains) names += " " + chain.name;
    tools::log_info("{}: {} chain{}:{}", options.output, draft.chains.size(),
                    draft.chains.size() == 1 ? "" : "s", names);
    return 0;
}

}  // namespace

CLI::App* add_discover(CLI::App& app, DiscoverOptions& options) {
    CLI::App* command =
        app.add_subcommand("discover", "Watch a program once and draft its chains.yaml");
    command->footer("After the options: -- program [args...]");
    command->add_option("-o,--output", options.output, "The draft [chains.yaml]");
    command->add_option("--trace", options.trace,
                        "Draft from this trace and run nothing; a program, if given, only names "
                        "what the trace is of");
    command->add_flag("--keep-trace", options.keep_trace,
                      "Keep the trace beside the draft, as <stem>.ugtrace");
    command->add_flag("--force", options.force, "Replace the draft if it is there");
    command->add_flag("--json", options.json, "Print JSON; what the program prints goes to stderr");
    add_traced_run_options(*command, options.seconds, options.real_libcuda);
    return command;
}

int cmd_discover(const DiscoverOptions& options, const std::vector<std::string>& program) {
    const std::string wrong = check(options, program);
    if (!wrong.empty()) return fail(kExitUsage, wrong);
    const auto folder = TemporaryFolder::make();
    if (!folder) return fail(kExitFailure, folder.error());

    std::string path = (*folder)->path() + "/run.ugtrace";
    if (options.keep_trace) path = fs::path(options.output).replace_extension(".ugtrace").string();
    if (!options.trace.empty()) path = options.trace;
    if (options.trace.empty()) {
        if (const int code = watch(options, program, (*folder)->path(), path)) return code;
        if (options.keep_trace) tools::log_info("wrote {}", path);
    }
    const auto trace = trace::read_trace(path);
    if (!trace) return fail(kExitFailure, trace.error());
    warn(trace->warnings());

    const config::Config nothing_known;
    const auto seen = discover::observe(*trace, trace::TaskMatcher(nothing_known, *trace));
    discover::Activities activities = discover::find_activities(seen);
    const auto rules = discover::choose_rules(seen, activities);
    const discover::Draft draft = discover::write_draft(
        seen, activities, rules, program.empty() ? "the trace " + path : shell_line(program));
    if (!draft.chains.empty()) return write(options, draft, activities);
    std::istringstream lines(draft.yaml);
    for (std::string line; std::getline(lines, line);) tools::log_info("{}", line);
    return fail(
        kExitFailure,
        fmt::format("found nothing that the program does periodically on the GPU, accepted: "
                    "at least {} frames of something (watch it longer)",
                    discover::kMinFrames));
}

}  // namespace urgengo::cli
