// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/sim_rows.h"

#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "host/config/config_reader.h"
#include "host/config/presets.h"
#include "tools/bench/smoke/bench_noise.h"
#include "tools/bench/smoke/bench_plan.h"
#include "tools/bench/smoke/bench_variant.h"
#include "tools/bench/smoke/level_yaml.h"
#include "tools/sim/governed_subject.h"
#include "tools/sim/profiled.h"

namespace urgengo::cli {
namespace {

Variant variant_of(const Row& row) {
    return row.variant.empty() ? Variant{} : *parse_variant(row.variant);
}

/// As `urgengo run` reads it from a file that changes the preset so.
config::Scheduler scheduler_of(const Row& row) {
    const std::string keys = scheduler_keys(variant_of(row));
    const std::string yaml =
        "{version: 1, chains: [{name: c, period_ms: 1, deadline_ms: 1, tasks: [{name: t}]}]" +
        (keys.empty() ? "" : ", scheduler: " + keys) + "}";
    return config::parse_config(yaml, "row", row.preset)->scheduler;
}

/// The program's own, as `urgengo run --preset` reads it with the row's changes.
config::Config recorded_config(const Row& row, const SimWorkload& workload,
                               const chains::Scenario& scenario) {
    config::Config config = workload.recorded->config;
    const std::string keys = scheduler_keys(variant_of(row));
    const std::string yaml =
        keys.empty() ? workload.yaml : *set_keys(workload.yaml, workload.path, "scheduler", keys);
    config.scheduler = config::parse_config(yaml, workload.path, row.preset)->scheduler;
    for (std::size_t i = 0; i < config.chains.size(); ++i) {
        const chains::Chain& chain = workload.workload.chains[i];
        const auto from_ms = [](double ms) {
            return std::chrono::nanoseconds(std::llround(ms * 1e6));
        };
        config.chains[i].period = from_ms(scenario.period_ms(chain));
        config.chains[i].deadline = from_ms(scenario.deadline_ms(chain));
    }
    return config;
}

}  // namespace

std::vector<std::string> expand_rows(const std::vector<std::string>& rows) {
    std::vector<std::string> list;
    for (const std::string& row : rows) {
        if (row != kAllRows) {
            list.push_back(row);
            continue;
        }
        list.emplace_back(kBareRow);
        for (std::string& preset : config::list_presets()) list.push_back(std::move(preset));
    }
    return list;
}

std::string check_sim_row(const std::string& name) {
    std::string wrong = check_row(name);
    if (!wrong.empty()) return wrong;
    const Row row = parse_row(name);
    const auto lacks = [&](const char* what) {
        return fmt::format("--rows: found '{}', not simulated: {}", name, what);
    };
    if (!row.hints) return lacks("programs without hints");
    const Variant variant = variant_of(row);
    if (variant.learn) return lacks("learning");
    if (variant.nice) return lacks("priorities of the host's cores");
    if (variant.tracking == config::Tracking::kAsync) return lacks("tracking async");
    return {};
}

std::unique_ptr<sim::Subject> make_sim_row(const std::string& name, const SimWorkload& workload,
                                           const chains::Scenario& scenario, std::uint32_t seed,
                                           std::chrono::nanoseconds mark_late) {
    const Row row = parse_row(name);
    if (row.preset.empty()) return sim::make_bare();
    config::Profile profile =
        workload.recorded ? workload.recorded->profile : sim::profiled(workload.workload);
    if (const unsigned pct = variant_of(row).noise_pct; pct > 0) add_noise(profile, pct, seed);
    const config::Config config =
        workload.recorded ? recorded_config(row, workload, scenario)
                          : sim::configured(workload.workload, scenario, scheduler_of(row));
    return std::make_unique<sim::GovernedSubject>(config, profile, mark_late);
}

}  // namespace urgengo::cli
