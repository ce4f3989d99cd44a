// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/bench_runner.h"

#include <fmt/format.h>

#include <optional>

#include "host/base/atomic_file.h"
#include "host/config/file_text.h"
#include "tools/bench/smoke/bench_floor.h"
#include "tools/bench/smoke/bench_noise.h"
#include "tools/bench/smoke/level_yaml.h"
#include "tools/log/log.h"
#include "tools/urgengo/program/run_process.h"
#include "tools/urgengo/progress_bar.h"

namespace urgengo::cli {
namespace {

/// @returns whether it was interrupted
Result<bool> run_step(const Arguments& arguments, const Environment& environment,
                      const std::string& what = "") {
    std::optional<ProgressBar> bar;
    if (!what.empty()) bar.emplace().show(-1, what);
    const auto process = run_process(arguments, environment);
    if (!process) return Error{process.error()};
    if (process->interrupted) return true;
    if (process->exit_code == 0) return false;
    return Error{fmt::format("exit code {} from: {}\n{}", process->exit_code, shell_line(arguments),
                             process->output)};
}

/// A row that was not scheduled must not pass for one that was, nor the other way round.
std::string why_not_its_row(const RunResult& run) {
    const bool loaded = run.urgengo != "not loaded";
    const bool active = loaded && run.urgengo != "loaded, off";
    if (parse_row(run.row).preset.empty())
        return loaded ? "UrgenGo was loaded into the bare program" : "";
    return active ? "" : "UrgenGo did nothing in the program: " + run.urgengo;
}

Result<RunResult> read_run(const PlannedRun& planned) {
    const auto json = config::read_file(planned.json);
    if (!json) return Error{json.error()};
    auto run = parse_report(*json, planned.json);
    if (!run) return run;
    run->row = planned.row;
    run->f_a = planned.f_a;
    run->repeat = planned.repeat;
    run->seed = planned.seed;
    run->yaml = planned.yaml;
    run->trace = planned.trace;
    const std::string wrong = why_not_its_row(*run);
    if (!wrong.empty()) return Error{wrong + ", in: " + shell_line(planned.arguments)};
    if (const auto stats = config::read_file(planned.stats)) run->stats = *stats;
    return run;
}

/// One run for each chain; their reports in one, in the place of a run's. Says whose turn it is.
/// @returns whether it was interrupted
Result<bool> run_each_alone(const PlannedRun& planned, const std::string& workload,
                            const Environment& environment) {
    const auto text = config::read_file(workload);
    if (!text) return Error{text.error()};
    const auto chains = chain_names(*text, workload);
    if (!chains) return Error{chains.error()};
    std::vector<std::string> reports;
    for (const std::string& chain : *chains) {
        tools::log_info("chain {}", chain);
        Arguments arguments = planned.arguments;
        arguments.insert(arguments.end(), {"--only", chain});
        auto interrupted = run_step(arguments, environment);
        if (!interrupted || *interrupted) return interrupted;
        auto report = config::read_file(planned.json);
        if (!report) return Error{report.error()};
        reports.push_back(std::move(*report));
    }
    const auto combined = combine_reports(reports, *chains);
    if (!combined) return Error{combined.error()};
    const auto written = write_file_atomically(planned.json, *combined);
    if (!written) return written;
    return false;
}

Result<bool> write_yaml(const PlannedYaml& planned) {
    const auto text = config::read_file(planned.source);
    if (!text) return Error{text.error()};
    auto scaled = scale_level(*text, planned.source, planned.f_a, planned.f_d);
    if (scaled && !planned.scheduler.empty())
        scaled = set_keys(*scaled, planned.path, "scheduler", planned.scheduler);
    if (scaled && !planned.cpu.empty())
        scaled = set_keys(*scaled, planned.path, "cpu", planned.cpu);
    if (!scaled) return Error{scaled.error()};
    return write_file_atomically(planned.path, *scaled);
}

/// @returns whether it was interrupted
Result<bool> learn(const PlannedProfile& planned, const Environment& environment) {
    if (planned.arguments.empty()) return false;
    tools::log_info("learning a profile{}", planned.hints ? "" : " without hints");
    return run_step(planned.arguments, environment, "learning a profile");
}

/// Everything before the first run. @returns whether it was interrupted
Result<bool> prepare(const BenchPlan& plan, const Environment& environment,
                     const Environment& scheduled, std::vector<ProfileSummary>& profiles) {
    if (!plan.calibrate.empty()) {
        tools::log_info("calibrating the workload");
        const auto interrupted = run_step(plan.calibrate, environment, "calibrating the workload");
        if (!interrupted) return Error{"calibration failed: " + interrupted.error()};
        if (*interrupted) return true;
    }
    for (const PlannedYaml& yaml : plan.yamls) {
        if (const auto written = write_yaml(yaml); !written) return Error{written.error()};
    }
    for (const PlannedProfile& planned : plan.profiles) {
        const auto interrupted = learn(planned, scheduled);
        if (!interrupted) return Error{"learning a profile failed: " + interrupted.error()};
        if (*interrupted) return true;
        auto summary = summarize_profile(planned);
        if (!summary) return Error{summary.error()};
        tools::log_info("profile {}", describe(*summary));
        profiles.push_back(std::move(*summary));
    }
    for (const PlannedNoise& noise : plan.noises) {
        if (const auto written = write_noisy_profile(noise); !written)
            return Error{written.error()};
    }
    return false;
}

}  // namespace

Result<BenchOutcome> carry_out(const BenchPlan& plan, const Environment& environment) {
    BenchOutcome outcome;
    Environment scheduled = environment;
    for (const auto& [name, value] : plan.scheduled) scheduled[name] = value;
    const auto stopped = prepare(plan, environment, scheduled, outcome.profiles);
    if (!stopped) return Error{stopped.error()};
    if (*stopped) return BenchOutcome{true, {}, {}};
    ProgressBar bar;
    for (const PlannedRun& planned : plan.runs) {
        const std::string number =
            fmt::format("[{}/{}]", outcome.runs.size() + 1, plan.runs.size());
        tools::log_info("{} f_a {}, {}, seed {}", number, planned.f_a, planned.row, planned.seed);
        bar.show_step(outcome.runs.size(), plan.runs.size(),
                      fmt::format("{}, f_a {}", planned.row, planned.f_a));
        Environment variables = planned.yaml.empty() ? environment : scheduled;
        if (!planned.trace.empty()) variables["URGENGO_TRACE"] = planned.trace;
        const auto interrupted = planned.each_chain_alone
                                     ? run_each_alone(planned, plan.workload, variables)
                                     : run_step(planned.arguments, variables);
        const bool complete = interrupted && !*interrupted;
        auto run = complete ? read_run(planned) : Result<RunResult>(Error{""});
        if (run) tools::log_info("{} {:.1f} % missed", number, run->miss_pct);
        if (!interrupted) return Error{"run failed: " + interrupted.error()};
        if (*interrupted) return BenchOutcome{true, {}, {}};
        if (!run) return Error{"run failed: " + run.error()};
        outcome.runs.push_back(std::move(*run));
    }
    return outcome;
}

}  // namespace urgengo::cli
