// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/sim_rows.h"

#include <fmt/format.h>

#include <utility>

#include "host/config/config_reader.h"
#include "host/config/presets.h"
#include "tools/bench/smoke/bench_noise.h"
#include "tools/bench/smoke/bench_plan.h"
#include "tools/bench/smoke/bench_variant.h"
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
    if (variant.tracking == config::Tracking::kAsync) return lacks("tracking async");
    return {};
}

std::unique_ptr<sim::Subject> make_sim_row(const std::string& name,
                                           const chains::Workload& workload,
                                           const chains::Scenario& scenario, std::uint32_t seed,
                                           std::chrono::nanoseconds mark_late) {
    const Row row = parse_row(name);
    if (row.preset.empty()) return sim::make_bare();
    config::Profile profile = sim::profiled(workload);
    if (const unsigned pct = variant_of(row).noise_pct; pct > 0) add_noise(profile, pct, seed);
    return std::make_unique<sim::GovernedSubject>(
        sim::configured(workload, scenario, scheduler_of(row)), profile, mark_late);
}

}  // namespace urgengo::cli
