// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/bench_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "host/config/presets.h"
#include "tools/bench/smoke/bench_variant.h"

namespace urgengo::cli {
namespace {

constexpr int kProfileFrames = 5 + 2;

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

Arguments program_command(double f_a, bool hints, double seconds, std::uint32_t seed,
                          const BenchOptions& options, const BenchPaths& paths) {
    Arguments arguments{paths.chains, "run", "--workload", paths.workload};
    add(arguments, "--f-a", f_a);
    add(arguments, "--f-d", options.f_d);
    add(arguments, "--threads", options.threads);
    add(arguments, "--seconds", seconds);
    add(arguments, "--seed", std::to_string(seed));
    add(arguments, "--cpu", options.cpu);
    add(arguments, "--sync", options.sync);
    add(arguments, "--queue", options.queue);
    if (options.frees > 0) add(arguments, "--frees", std::to_string(options.frees));
    if (options.variable) arguments.push_back("--variable");
    if (!hints) arguments.push_back("--no-hints");
    return arguments;
}

/// @param row  of checked options; its variant, as the options complete it
Variant variant_of(const Row& row, const BenchOptions& options) {
    if (row.variant.empty()) return {};
    const auto parsed = parse_variant(row.variant);
    Variant variant = parsed ? *parsed : Variant{};
    if (variant.waits_for_batches() && !variant.eval_interval_us)
        variant.eval_interval_us = options.eval_interval_us;
    return variant;
}

void append(Arguments& arguments, const Arguments& more) {
    arguments.insert(arguments.end(), more.begin(), more.end());
}

/// Plans what all rows with hints, or all without, share; and their runs.
class KindPlanner {
  public:
    KindPlanner(bool hints, const BenchOptions& options, const BenchPaths& paths, BenchPlan& plan)
        : hints_(hints),
          suffix_(hints ? "" : kNoHintsSuffix),
          options_(options),
          paths_(paths),
          plan_(plan),
          given_profile_(hints ? options.profile : options.profile_nohints) {}

    void plan_files(double profile_seconds) {
        for (const double f_a : options_.f_a) {
            plan_yaml(f_a, {});
            for (const std::string& name : options_.rows) {
                const Row row = parse_row(name);
                if (row.hints != hints_ || row.preset.empty()) continue;
                plan_yaml(f_a, row);
                plan_noise(variant_of(row, options_).noise_pct);
            }
        }
        PlannedProfile profile{hints_, "given", 0, profile_path(), {}};
        if (given_profile_.empty()) {
            const std::string yaml = plan_yaml(kProfileLoad, {});
            profile.way = options_.profile_isolated ? "isolated" : "in-situ";
            profile.seconds = options_.profile_seconds.value_or(profile_seconds);
            profile.arguments = {paths_.urgengo, "profile", "-c", yaml, "--" + profile.way};
            add(profile.arguments, "-o", profile.path);
            profile.arguments.push_back("--");
            const std::uint32_t unused_seed =
                options_.seed + static_cast<std::uint32_t>(options_.repeats);
            append(profile.arguments, program_command(kProfileLoad, hints_, profile.seconds,
                                                      unused_seed, options_, paths_));
            profile.arguments.push_back("--quiet");
        }
        plan_.profiles.push_back(std::move(profile));
    }

    /// Completes the run of a row that is not bare.
    void schedule(PlannedRun& run, const Row& row) const {
        const unsigned noise_pct = variant_of(row, options_).noise_pct;
        run.yaml = yaml_path(run.f_a, row);
        run.arguments = {paths_.urgengo, "run", "-c", run.yaml, "--quiet"};
        add(run.arguments, "--profile", profile_path(noise_pct, run.seed));
        add(run.arguments, "--preset", row.preset);
        add(run.arguments, "--stats", run.stats);
        add(run.arguments, "--interposer", options_.interposer);
        run.arguments.push_back("--");
    }

  private:
    std::string yaml_path(double f_a, const Row& row) const {
        const std::string mark = row.variant.empty() ? "" : kVariantMark + row.variant;
        return fmt::format("{}/f_a_{}{}{}.yaml", paths_.folder, f_a, mark, suffix_);
    }

    std::string plan_yaml(double f_a, const Row& row) {
        const std::string path = yaml_path(f_a, row);
        const auto planned = [&](const PlannedYaml& yaml) { return yaml.path == path; };
        if (std::none_of(plan_.yamls.begin(), plan_.yamls.end(), planned)) {
            const Variant variant = variant_of(row, options_);
            plan_.yamls.push_back({hints_ ? paths_.yaml : paths_.yaml_nohints, f_a, path,
                                   options_.f_d, scheduler_keys(variant), cpu_keys(variant)});
        }
        return path;
    }

    /// One wrong profile for each seed, whatever the row and the load.
    void plan_noise(unsigned pct) {
        if (pct == 0) return;
        for (int repeat = 0; repeat < options_.repeats; ++repeat) {
            const std::uint32_t seed = options_.seed + static_cast<std::uint32_t>(repeat);
            const std::string path = profile_path(pct, seed);
            const auto planned = [&](const PlannedNoise& noise) { return noise.path == path; };
            if (std::none_of(plan_.noises.begin(), plan_.noises.end(), planned))
                plan_.noises.push_back({profile_path(), path, pct, seed});
        }
    }

    std::string profile_path(unsigned noise_pct = 0, std::uint32_t seed = 0) const {
        if (noise_pct != 0)
            return fmt::format("{}/noise_{}_seed_{}{}.profile.json", paths_.folder, noise_pct, seed,
                               suffix_);
        if (!given_profile_.empty()) return given_profile_;
        return fmt::format("{}/learned{}.profile.json", paths_.folder, suffix_);
    }

    bool hints_;
    std::string suffix_;
    const BenchOptions& options_;
    const BenchPaths& paths_;
    BenchPlan& plan_;
    std::string given_profile_;
};

PlannedRun plan_run(double f_a, const std::string& name, int repeat, const KindPlanner& kind,
                    const BenchOptions& options, const BenchPaths& paths) {
    const Row row = parse_row(name);
    PlannedRun run;
    run.row = name;
    run.f_a = f_a;
    run.repeat = repeat;
    run.seed = options.seed + static_cast<std::uint32_t>(repeat);
    const std::string stem = fmt::format("{}/{}_{}_{}", paths.folder, name, f_a, repeat);
    run.json = stem + ".json";
    run.each_chain_alone = name == kFloorRow;
    if (!row.preset.empty()) {
        run.stats = stem + ".stats.json";
        if (options.truth) run.trace = stem + ".ugtrace";
        kind.schedule(run, row);
    }
    append(run.arguments,
           program_command(f_a, row.hints, options.seconds, run.seed, options, paths));
    add(run.arguments, "--json", run.json);
    run.arguments.push_back("--instances");
    run.arguments.push_back("--quiet");
    return run;
}

bool any_scheduled(const BenchOptions& options, bool hints) {
    return std::any_of(options.rows.begin(), options.rows.end(), [&](const std::string& name) {
        const Row row = parse_row(name);
        return !row.preset.empty() && row.hints == hints;
    });
}

}  // namespace

Row parse_row(const std::string& name) {
    Row row{name, true};
    if (row.preset.ends_with(kNoHintsSuffix)) {
        row.hints = false;
        row.preset.resize(row.preset.size() - std::string(kNoHintsSuffix).size());
    }
    if (row.preset == kBareRow || row.preset == kFloorRow) {
        row.preset.clear();
    } else if (const auto mark = row.preset.find(kVariantMark); mark != std::string::npos) {
        row.variant = row.preset.substr(mark + 1);
        row.preset.resize(mark);
    }
    return row;
}

std::string check_row(const std::string& name, bool floor_too) {
    const Row row = parse_row(name);
    if (floor_too && name == kFloorRow) return {};
    const bool bare = row.preset.empty() && name.starts_with(kBareRow);
    if (!bare && !config::preset(row.preset)) {
        return "--rows: found '" + name + "', accepted: bare, " + (floor_too ? "floor, " : "") +
               config::preset_names() + "; without hints: bare-nohints, ...";
    }
    if (name.find(kVariantMark) == std::string::npos) return {};
    const auto variant = parse_variant(row.variant);
    return variant ? "" : "--rows: found '" + name + "', " + variant.error();
}

bool takes_interval(const Row& row) {
    if (row.variant.empty()) return false;
    const Variant variant = *parse_variant(row.variant);
    return variant.waits_for_batches() && !variant.eval_interval_us;
}

std::string check(const BenchOptions& options) {
    std::set<std::string> rows;
    bool interval_used = false;
    for (const std::string& name : options.rows) {
        std::string wrong = check_row(name, /*floor_too=*/true);
        if (!wrong.empty()) return wrong;
        interval_used |= takes_interval(parse_row(name));
        if (!rows.insert(name).second) return "--rows: found '" + name + "' twice, accepted: once";
    }
    if (options.eval_interval_us && !interval_used) {
        return "--eval-interval-us: found no row that uses it, accepted: with a row such as "
               "urgengo+overlapped";
    }
    const std::set<double> levels(options.f_a.begin(), options.f_a.end());
    if (levels.size() != options.f_a.size()) {
        return "--f-a: found the same number twice, accepted: once";
    }
    const bool with = any_scheduled(options, true), without = any_scheduled(options, false);
    if (without && options.threads == "task") {
        return "--threads: found 'task', accepted without hints: chain";
    }
    if (!with && !options.profile.empty()) {
        return "--profile: found no row with hints that uses it, accepted: --profile-nohints";
    }
    if (!without && !options.profile_nohints.empty()) {
        return "--profile-nohints: found no row without hints that uses it, accepted: --profile";
    }
    return {};
}

double default_profile_seconds(std::chrono::nanoseconds longest_period) {
    const std::chrono::duration<double> period = longest_period / kProfileLoad;
    return std::ceil(kProfileFrames * period.count());
}

BenchPlan make_plan(const BenchOptions& options, const BenchPaths& paths, double profile_seconds) {
    BenchPlan plan;
    plan.workload = paths.workload;
    if (options.workload.empty()) plan.calibrate = calibrate_command(options, paths);
    if (!paths.real_libcuda.empty()) plan.scheduled["URGENGO_REAL_LIBCUDA"] = paths.real_libcuda;
    KindPlanner with_hints(true, options, paths, plan), no_hints(false, options, paths, plan);
    if (any_scheduled(options, true)) with_hints.plan_files(profile_seconds);
    if (any_scheduled(options, false)) no_hints.plan_files(profile_seconds);
    for (const double f_a : options.f_a) {
        for (int repeat = 0; repeat < options.repeats; ++repeat) {
            for (const std::string& name : options.rows) {
                const KindPlanner& kind = parse_row(name).hints ? with_hints : no_hints;
                plan.runs.push_back(plan_run(f_a, name, repeat, kind, options, paths));
            }
        }
    }
    return plan;
}

}  // namespace urgengo::cli
