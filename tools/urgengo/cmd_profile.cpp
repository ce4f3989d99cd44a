// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/cmd_profile.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <filesystem>

#include "host/base/atomic_file.h"
#include "host/base/hash.h"
#include "host/config/config_reader.h"
#include "host/config/connections.h"
#include "host/config/file_text.h"
#include "host/config/profile_json.h"
#include "host/config/profile_reader.h"
#include "host/config/resolved_config.h"
#include "tools/log/log.h"
#include "tools/trace/profile_builder.h"
#include "tools/trace/profile_merge.h"
#include "tools/urgengo/command_json.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/paths.h"
#include "tools/urgengo/profile_table.h"
#include "tools/urgengo/program/environment_check.h"
#include "tools/urgengo/program/traced_run.h"
#include "tools/urgengo/temporary_folder.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;

constexpr char kFooter[] =
    "After the options: -- program [args...]\n\n"
    "In situ (the default), the full program runs as it is, and a kernel's own time is told from\n"
    "contention by who else was on the GPU. Isolated, only one task's GPU work is admitted at a\n"
    "time: times are its own, but frames are late.\n"
    "Kernels are timed by CUPTI, which the program or a CUDA Toolkit brings (--source cupti), or\n"
    "by marks: tiny kernels of our own around each (--source marks; about 2 us of GPU time each,\n"
    "taken off). Either slows launching down, so the program is then run a second time, in which\n"
    "nothing is timed, for launch times, latencies and CPU times (--passes 1: it is not, and "
    "those\n"
    "stay unknown). Do not measure while profiling.\n"
    "Instances come from hints or NVTX ranges if there are any, else they are learned from what\n"
    "the segments between waits repeat. Model building, tuning and warming up before the first\n"
    "are left out.\n"
    "Exits with 0 if a profile was written (also if --seconds or Ctrl-C ended the program), with\n"
    "the program's own code if it failed, with 1 if nothing was learned, with 2 for wrong usage.";

struct Sources {
    std::string yaml;
    std::string out;
    config::Config config;
    std::uint64_t yaml_hash = 0;
};

/// @returns what is wrong with the options; empty if nothing is
std::string check(const ProfileOptions& options, const std::vector<std::string>& program) {
    if (options.isolated && options.in_situ) {
        return "found --isolated and --in-situ, accepted: one of them";
    }
    if (options.config.empty() && !fs::exists(kDefaultConfig)) {
        return "no config: accepted: -c FILE, or a chains.yaml in the current folder";
    }
    if (options.trace.empty()) {
        if (!program.empty()) return {};
        return "no program, accepted: urgengo profile [options] -- program [args...], or --trace "
               "FILE";
    }
    const char* excluded = options.isolated           ? "--isolated"
                           : options.in_situ          ? "--in-situ"
                           : options.seconds > 0      ? "--seconds"
                           : options.keep_trace       ? "--keep-trace"
                           : options.source != "auto" ? "--source"
                                                      : nullptr;
    if (!excluded) return {};
    return fmt::format("found {} with --trace, which runs nothing, accepted: one of them",
                       excluded);
}

Result<Sources> read_sources(const ProfileOptions& options) {
    Sources sources;
    sources.yaml = options.config.empty() ? kDefaultConfig : options.config;
    sources.out = options.out.empty() ? config::profile_sibling(sources.yaml) : options.out;
    const std::string obstacle = why_not_writable(sources.out);
    if (!obstacle.empty()) return Error{sources.out + ": cannot be written: " + obstacle};
    const auto text = config::read_file(sources.yaml);
    if (!text) return Error{text.error()};
    auto config = config::parse_config(*text, sources.yaml);
    if (!config) return Error{config.error()};
    if (config->chains.empty()) return Error{sources.yaml + ": has no chains to profile"};
    sources.config = std::move(*config);
    sources.yaml_hash = fnv1a64(*text);
    return sources;
}

/// One task's GPU work at a time, in the order of deadlines, and nothing else changed.
void isolate(config::Config& config) {
    config.mode = config::Mode::kEnforce;
    for (config::Chain& chain : config.chains) chain.mode = config::Mode::kEnforce;
    config.scheduler.policy = config::Policy::kEdf;
    config.scheduler.binding = config::Binding::kNone;
    config.scheduler.admission = config::Admission::kExclusive;
}

/// The profile that may be there already is left out: it is what is to be learned.
Result<std::string> write_resolved(const Sources& sources, config::Config config, bool isolated,
                                   const std::string& folder) {
    if (isolated) isolate(config);
    const std::string path = folder + "/profiling.resolved.json";
    const config::SourceStamp stamp = {{absolute(sources.yaml), sources.yaml_hash}};
    const auto written =
        write_file_atomically(path, config::to_resolved_json(config, nullptr, stamp));
    if (!written) return Error{written.error()};
    return path;
}

bool found_anything(const config::Profile& profile) {
    return std::any_of(profile.chains.begin(), profile.chains.end(), [](const auto& chain) {
        return std::any_of(chain.tasks.begin(), chain.tasks.end(),
                           [](const auto& task) { return !task.kernels.empty(); });
    });
}

/// @returns what the trace's header says of CUPTI; empty if it was as asked for
std::string note_of(const trace::Trace& trace) {
    const abi::TraceHeader& header = trace.header();
    return std::string(header.note, strnlen(header.note, sizeof header.note));
}

/// @returns whether nothing was timed, as it was to be by CUPTI, and could not
bool was_refused(const ProfileOptions& options, const std::string& trace_path) {
    if (options.source != "cupti") return false;
    const auto trace = trace::read_trace(trace_path);
    return trace && trace->header().kernel_times == abi::TraceTimes::kRefused;
}

/// @param plain_path  a trace of the same in which nothing is timed; empty: there is none
/// @returns an exit code
int learn(const ProfileOptions& options, const Sources& sources, const std::string& trace_path,
          const std::string& plain_path, const std::string& program) {
    const auto trace = trace::read_trace(trace_path);
    if (!trace) return fail(kExitFailure, trace.error());
    const std::string note = note_of(*trace);
    if (trace->header().kernel_times == abi::TraceTimes::kRefused)
        return fail(kExitFailure, "kernels cannot be timed by CUPTI: " + note);
    if (!note.empty()) warn({"kernels were timed by marks, not by CUPTI: " + note});
    Result<trace::Trace> plain = trace::Trace();
    if (!plain_path.empty()) {
        plain = trace::read_trace(plain_path);
        if (!plain) return fail(kExitFailure, plain.error());
    }
    const trace::LearnedProfile learned = trace::learn_profile(
        *trace, sources.config, program, plain_path.empty() ? nullptr : &*plain);
    if (!options.json) fmt::print("{}", profile_table(learned));
    std::fflush(stdout);
    warn(learned.warnings);
    if (!found_anything(learned.profile)) {
        if (options.json) print_as_json(profile_json("", learned));
        return fail(kExitFailure, "nothing was learned of any task, so nothing was written");
    }
    config::Profile profile = learned.profile;
    if (options.merge && fs::exists(sources.out)) {
        const auto older = config::read_profile(sources.out);
        if (!older) return fail(kExitUsage, older.error());
        const auto merged = trace::merge_profiles(*older, profile);
        if (!merged) return fail(kExitFailure, sources.out + ": " + merged.error());
        profile = *merged;
    }
    const auto written = write_file_atomically(sources.out, config::to_profile_text(profile));
    if (!written) return fail(kExitFailure, written.error());
    tools::log_info("wrote {}{}", sources.out,
                    profile.runs > 1 ? fmt::format(" ({} runs)", profile.runs) : "");
    if (options.json) print_as_json(profile_json(sources.out, learned));
    return 0;
}

/// @returns "dir/chains.ugtrace" for "dir/chains.profile.json"
std::string kept_trace(const std::string& out) {
    fs::path path = out;
    path.replace_extension();
    if (path.extension() == ".profile") path.replace_extension();
    path += ".ugtrace";
    return absolute(path.string());
}

std::string plain_trace(const std::string& folder) {
    return folder + "/plain.ugtrace";
}

/// The second run, which is as the program is by itself, whatever the first was.
Result<TracedOutcome> run_untimed(const ProgramSetup& setup,
                                  const std::vector<std::string>& program,
                                  const Environment& environment, const Sources& sources,
                                  const std::string& folder, const TracedRun& first) {
    const auto resolved = write_resolved(sources, sources.config, false, folder);
    if (!resolved) return Error{resolved.error()};
    TracedRun run;
    run.config = *resolved;
    run.mode = "observe";
    run.keeps_stdout = first.keeps_stdout;
    run.what = fmt::format("profiling {}, run 2 of 2", setup.name);
    run.trace = plain_trace(folder);
    run.limit = first.limit;
    run.kernels = "0";
    tools::log_info("{} runs again, with nothing timed", program[0]);
    const auto outcome = run_traced(setup, program, environment, run);
    if (outcome && outcome->exit_code != 0) {
        warn(
            {fmt::format("{}, the second time: {}; launch times and latencies are of what it did "
                         "until then",
                         program[0], outcome->how)});
    }
    return outcome;
}

int run_and_learn(const ProfileOptions& options, const Sources& sources,
                  const std::vector<std::string>& program) {
    const Environment environment = current_environment();
    const ProgramSetup setup = set_up_program(program, options.real_libcuda, environment);
    if (setup.exit_code != 0) return fail(setup.exit_code, setup.message);
    warn(setup.warnings);
    const auto folder = TemporaryFolder::make();
    if (!folder) return fail(kExitFailure, folder.error());
    const auto resolved =
        write_resolved(sources, sources.config, options.isolated, (*folder)->path());
    if (!resolved) return fail(kExitFailure, resolved.error());

    TracedRun run;
    run.config = *resolved;
    run.mode = options.isolated ? "enforce" : "observe";
    run.trace = options.keep_trace ? kept_trace(sources.out) : (*folder)->path() + "/run.ugtrace";
    run.limit = std::chrono::milliseconds(static_cast<std::int64_t>(options.seconds * 1000));
    run.kernels = options.source;
    run.cupti = options.cupti;
    run.keeps_stdout = options.json;
    run.what = fmt::format("profiling {}, run 1 of {}", setup.name, options.passes);
    // Only where it schedules may UrgenGo change the program's timing.
    if (options.isolated) run.connections = config::connections_of(sources.config);
    const auto outcome = run_traced(setup, program, environment, run);
    if (!outcome) return fail(kExitFailure, outcome.error());
    if (options.keep_trace) tools::log_info("wrote {}", run.trace);
    if (outcome->exit_code != 0) {
        warn({fmt::format("{}: {}; the profile is of what it did until then", program[0],
                          outcome->how)});
    }
    std::string plain;
    int exit_code = outcome->exit_code;
    // Who pressed Ctrl-C does not wish to see it run again.
    if (options.passes > 1 && exit_code == 0 && !outcome->interrupted &&
        !was_refused(options, run.trace)) {
        const auto again =
            run_untimed(setup, program, environment, sources, (*folder)->path(), run);
        if (!again) return fail(kExitFailure, again.error());
        exit_code = again->exit_code;
        plain = plain_trace((*folder)->path());
    }
    const int learned = learn(options, sources, run.trace, plain, setup.name);
    return learned != 0 ? learned : exit_code;
}

}  // namespace

CLI::App* add_profile(CLI::App& app, ProfileOptions& options) {
    CLI::App* command = app.add_subcommand(
        "profile", "Run a program twice, and learn its tasks' kernels, times and segments");
    command->footer(kFooter);
    command->add_option("-c,--config", options.config, "The chains [chains.yaml]");
    command->add_option("-o,--out", options.out,
                        "The profile to write [<config's stem>.profile.json]");
    command->add_flag("--isolated", options.isolated, "Admit one task's GPU work at a time");
    command->add_flag("--in-situ", options.in_situ, "Change nothing: the default");
    command->add_flag("--merge", options.merge,
                      "Merge with the profile that is there: of the same program, GPU and clocks");
    command->add_option("--trace", options.trace,
                        "Learn from this trace of the same config and run nothing; a program, if "
                        "given, only names what the trace is of");
    command->add_flag("--keep-trace", options.keep_trace,
                      "Keep the trace, as <stem>.ugtrace beside the profile");
    command
        ->add_option("--source", options.source,
                     "What times kernels: cupti, marks, or auto: CUPTI if there is one [auto]")
        ->check(CLI::IsMember({"auto", "cupti", "marks"}));
    command->add_option("--cupti", options.cupti,
                        "A libcupti.so, where the program has none of its own");
    command
        ->add_option("--passes", options.passes,
                     "Runs of the program: the second, in which nothing is timed, gives launch "
                     "times and latencies [2]")
        ->check(CLI::Range(1, 2));
    command->add_flag("--json", options.json, "Print JSON; what the program prints goes to stderr");
    add_traced_run_options(*command, options.seconds, options.real_libcuda);
    return command;
}

int cmd_profile(const ProfileOptions& options, const std::vector<std::string>& program) {
    const std::string wrong = check(options, program);
    if (!wrong.empty()) return fail(kExitUsage, wrong);
    const auto sources = read_sources(options);
    if (!sources) return fail(kExitUsage, sources.error());
    if (options.trace.empty()) return run_and_learn(options, *sources, program);
    const std::string name = program.empty() ? "" : fs::path(program.front()).filename().string();
    return learn(options, *sources, options.trace, "", name);
}

}  // namespace urgengo::cli
