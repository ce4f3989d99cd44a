// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/bench_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "host/config/presets.h"

namespace urgengo::cli {
namespace {

void add(Arguments& arguments, const char* option, const std::string& value) {
    if (value.empty()) return;
    arguments.push_back(option);
    arguments.push_back(value);
}

void add(Arguments& arguments, const char* option, std::optional<double> value) {
    if (value) add(arguments, option, fmt::format("{}", *value));
}

Arguments calibrate_command(const BenchOptions& options, const BenchPaths& paths) {
    Arguments arguments{paths.chains, "calibrate", "--out", paths.workload};
    add(arguments, "--umin", options.umin);
    add(arguments, "--umax", options.umax);
    return arguments;
}

/// What `config` and `run` of urgengo-chains have in common.
Arguments chains_command(const char* command, double f_a, const BenchOptions& options,
                         const BenchPaths& paths) {
    Arguments arguments{paths.chains, command, "--workload", paths.workload};
    add(arguments, "--f-a", f_a);
    add(arguments, "--f-d", 1);
    add(arguments, "--threads", options.threads);
    return arguments;
}

PlannedLevel plan_level(double f_a, const BenchOptions& options, const BenchPaths& paths) {
    const std::string stem = fmt::format("{}/f_a_{}", paths.folder, f_a);
    PlannedLevel level{f_a, stem + ".yaml", stem + ".profile.json", {}};
    level.write_config = chains_command("config", f_a, options, paths);
    add(level.write_config, "--yaml", level.yaml);
    add(level.write_config, "--profile", level.profile);
    return level;
}

Arguments scheduler_command(const PlannedLevel& level, const PlannedRun& run,
                            const BenchPaths& paths) {
    Arguments arguments{paths.urgengo, "run", "-c", level.yaml, "--quiet"};
    add(arguments, "--profile", level.profile);
    add(arguments, "--preset", run.row);
    add(arguments, "--stats", run.stats);
    add(arguments, "--real-libcuda", paths.real_libcuda);
    arguments.push_back("--");
    return arguments;
}

PlannedRun plan_run(const PlannedLevel& level, const std::string& row, int repeat,
                    const BenchOptions& options, const BenchPaths& paths) {
    PlannedRun run;
    run.row = row;
    run.f_a = level.f_a;
    run.repeat = repeat;
    run.seed = options.seed + static_cast<std::uint32_t>(repeat);
    const std::string stem = fmt::format("{}/{}_{}_{}", paths.folder, row, level.f_a, repeat);
    run.json = stem + ".json";
    if (row != kBareRow) {
        run.stats = stem + ".stats.json";
        run.arguments = scheduler_command(level, run, paths);
    }
    Arguments program = chains_command("run", level.f_a, options, paths);
    add(program, "--seconds", options.seconds);
    add(program, "--seed", std::to_string(run.seed));
    add(program, "--cpu", options.cpu);
    add(program, "--sync", options.sync);
    add(program, "--queue", options.queue);
    add(program, "--json", run.json);
    program.push_back("--quiet");
    run.arguments.insert(run.arguments.end(), program.begin(), program.end());
    return run;
}

}  // namespace

std::string check(const BenchOptions& options) {
    std::set<std::string> rows;
    for (const std::string& row : options.rows) {
        if (row != kBareRow && !config::preset(row)) {
            return "--rows: found '" + row + "', accepted: bare, " + config::preset_names();
        }
        if (!rows.insert(row).second) return "--rows: found '" + row + "' twice, accepted: once";
    }
    const std::set<double> levels(options.f_a.begin(), options.f_a.end());
    if (levels.size() != options.f_a.size()) {
        return "--f-a: found the same number twice, accepted: once";
    }
    return {};
}

BenchPlan make_plan(const BenchOptions& options, const BenchPaths& paths) {
    BenchPlan plan;
    if (options.workload.empty()) plan.calibrate = calibrate_command(options, paths);
    for (const double f_a : options.f_a) plan.levels.push_back(plan_level(f_a, options, paths));
    for (const PlannedLevel& level : plan.levels) {
        for (int repeat = 0; repeat < options.repeats; ++repeat) {
            for (const std::string& row : options.rows) {
                plan.runs.push_back(plan_run(level, row, repeat, options, paths));
            }
        }
    }
    return plan;
}

}  // namespace urgengo::cli
