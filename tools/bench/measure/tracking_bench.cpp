// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/measure/tracking_bench.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "host/config/config_reader.h"
#include "host/config/limits.h"
#include "tools/bench/measure/bench_calls.h"
#include "tools/bench/smoke/bench_plan.h"
#include "tools/bench/smoke/bench_variant.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;
using Numbers = std::vector<double>;

constexpr double kFrameUs = 15'000;
/// @source a stream takes 1,020 launches, then the launching thread waits: H200, driver 580.159.04
constexpr double kMaxFrameLaunches = 800;

double median(Numbers values) {
    return spread(std::move(values)).median;
}

/// @returns f(a, b), pair by pair
template <typename F>
Numbers combine(const Numbers& a, const Numbers& b, F f) {
    Numbers result(std::min(a.size(), b.size()));
    std::transform(a.begin(), a.begin() + static_cast<std::ptrdiff_t>(result.size()), b.begin(),
                   result.begin(), f);
    return result;
}

double extra_pct(const Numbers& chain, const Numbers& nobody) {
    return median(combine(chain, nobody, [](double a, double b) { return (a / b - 1) * 100; }));
}

TrackingCellRun cell_run(const Json& json, double launches) {
    const auto numbers = [&](const char* kind, const char* name) {
        return json.at(kind).at(name).get<Numbers>();
    };
    const auto a_launch_ns = [&](const Numbers& us) { return median(us) / launches * 1e3; };
    const Numbers gpu = numbers("chain", "gpu_us"), nobody_gpu = numbers("nobody", "gpu_us");
    TrackingCellRun run;
    run.pairs = gpu.size();
    run.gpu_us = median(gpu);
    run.nobody_gpu_us = median(nobody_gpu);
    run.extra_gpu_pct = extra_pct(gpu, nobody_gpu);
    run.extra_elapsed_pct =
        extra_pct(numbers("chain", "elapsed_us"), numbers("nobody", "elapsed_us"));
    run.launch_cpu_ns = a_launch_ns(numbers("chain", "launch_cpu_us"));
    run.nobody_launch_cpu_ns = a_launch_ns(numbers("nobody", "launch_cpu_us"));
    run.cpu_ns = a_launch_ns(numbers("chain", "thread_cpu_us"));
    run.nobody_cpu_ns = a_launch_ns(numbers("nobody", "thread_cpu_us"));
    run.others_cpu_ns = a_launch_ns(
        combine(numbers("chain", "process_cpu_us"), numbers("chain", "thread_cpu_us"),
                [](double process, double thread) { return std::max(process - thread, 0.0); }));
    return run;
}

std::string add_statistics(std::vector<TrackingCellRun>& runs, const std::string& stats) {
    for (std::size_t i = 0; i < runs.size(); ++i) {
        const std::string name = bench::cell_chain(static_cast<int>(i));
        const std::string wrong = why_not_scheduled(stats, name);
        if (!wrong.empty()) return name + ": " + wrong;
        const Json chains = Json::parse(stats).at("chains");
        const auto its = std::find_if(chains.begin(), chains.end(),
                                      [&](const Json& c) { return c.at("name") == name; });
        const auto launches = its->at("launches").get<double>();
        runs[i].marks = its->at("marks").get<double>() / launches;
        runs[i].synchronisations = its->at("synchronisations").get<double>() / launches;
    }
    return {};
}

}  // namespace

std::string check(const BenchTrackingOptions& options) {
    std::set<std::string> rows;
    for (const std::string& name : options.rows) {
        std::string wrong = check_row(name);
        if (!wrong.empty()) return wrong;
        if (!parse_row(name).hints)
            return "--rows: found '" + name + "', accepted: rows without -nohints";
        if (const std::string& variant = parse_row(name).variant; !variant.empty())
            if (const auto its = parse_variant(variant); its->noise_pct > 0 || its->nice)
                return "--rows: found '" + name + "', accepted: rows without noise and nice";
        if (!rows.insert(name).second) return "--rows: found '" + name + "' twice, accepted: once";
    }
    if (!options.iterations.empty() && options.iterations.size() != options.kernel_us.size())
        return fmt::format("--iterations: found {}, accepted: one for each of {} --kernel-us",
                           options.iterations.size(), options.kernel_us.size());
    const std::size_t most = config::kMaxChains - 1 - static_cast<std::size_t>(options.chains);
    const std::size_t cells = options.kernel_us.size() * options.situations.size();
    if (cells > most)
        return fmt::format(
            "--kernel-us: found {} kernels and situations, accepted: {} beside {} "
            "idle --chains",
            cells, most, options.chains);
    return {};
}

int frame_launches(double kernel_us) {
    return static_cast<int>(std::clamp(std::round(kFrameUs / kernel_us), 1.0, kMaxFrameLaunches));
}

std::vector<TrackingCellPlan> plan_cells(const BenchTrackingOptions& options) {
    std::vector<TrackingCellPlan> cells;
    for (const std::string& situation : options.situations)
        for (const double us : options.kernel_us)
            cells.push_back({situation, us, frame_launches(us)});
    return cells;
}

bench::ConfigSpec plan_config(const BenchTrackingOptions& options, const std::string& name) {
    bench::ConfigSpec spec;
    for (const TrackingCellPlan& cell : plan_cells(options)) {
        const std::string chain = bench::cell_chain(static_cast<int>(spec.measured.size()));
        spec.measured.push_back({chain, chain, cell.kernel_us, cell.frame_launches});
    }
    spec.num_others = 1 + options.chains;
    const Row row = parse_row(name);
    // Read as a user's YAML would be, with a chain because there must be one.
    std::string yaml =
        "version: 1\nchains: [{name: c, period_ms: 1, deadline_ms: 1, tasks: [{name: t}]}]\n";
    if (!row.variant.empty()) {
        Variant variant = *parse_variant(row.variant);
        if (takes_interval(row)) variant.eval_interval_us = options.eval_interval_us;
        yaml += "scheduler: " + scheduler_keys(variant) + "\n";
    }
    spec.scheduler = config::parse_config(yaml, name, row.preset)->scheduler;
    return spec;
}

Result<std::vector<TrackingCellRun>> parse_tracking_run(
    const std::string& json, const std::string& stats, const std::vector<TrackingCellPlan>& cells) {
    std::vector<TrackingCellRun> runs;
    try {
        const Json parsed = Json::parse(json);
        for (std::size_t i = 0; i < cells.size(); ++i)
            runs.push_back(cell_run(parsed.at("cells").at(i), cells[i].frame_launches));
        const std::string wrong = stats.empty() ? "" : add_statistics(runs, stats);
        if (!wrong.empty()) return Error{wrong};
    } catch (const Json::exception& error) {
        return Error{error.what()};
    }
    return runs;
}

Spread TrackingBench::over_rounds(std::size_t row, std::size_t cell,
                                  double TrackingCellRun::*value) const {
    Numbers values;
    for (const auto& round : runs[row]) values.push_back(round[cell].*value);
    return spread(std::move(values));
}

}  // namespace urgengo::cli
