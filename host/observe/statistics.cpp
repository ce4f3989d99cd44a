// SPDX-License-Identifier: Apache-2.0
#include "host/observe/statistics.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

namespace urgengo::observe {
namespace {

double miss_ratio(const ChainStatistics& c) {
    return c.instances ? static_cast<double>(c.missed) / static_cast<double>(c.instances) : 0;
}

double overall_miss_ratio(const std::vector<const ChainStatistics*>& chains) {
    double sum = 0;
    int active = 0;
    for (const ChainStatistics* c : chains)
        if (c->instances) sum += miss_ratio(*c), ++active;
    return active ? sum / active : 0;
}

double mean_latency_ms(const ChainStatistics& c) {
    const std::uint64_t completed = c.finished - c.exited;
    return completed ? 1e-6 * static_cast<double>(c.latency_sum_ns) / static_cast<double>(completed)
                     : 0;
}

}  // namespace

std::string to_table(const std::vector<const ChainStatistics*>& chains, const std::string& mode,
                     const std::string& guard) {
    std::string out =
        fmt::format("urgengo: {}\n{:<20}{:>8}{:>8}{:>8}{:>8}{:>8}{:>10}{:>10}{:>10}{:>9}{:>10}\n",
                    mode, "chain", "frames", "missed", "miss %", "in row", "exited", "mean ms",
                    "max ms", "late ms", "holds", "held ms");
    for (const ChainStatistics* c : chains)
        out += fmt::format(
            "{:<20}{:>8}{:>8}{:>8.1f}{:>8}{:>8}{:>10.1f}{:>10.1f}{:>10.1f}{:>9}{:>10.1f}\n",
            c->name, c->instances.load(), c->missed.load(), 100 * miss_ratio(*c),
            c->most_misses_in_a_row.load(), c->exited.load(), mean_latency_ms(*c),
            1e-6 * static_cast<double>(c->latency_max_ns),
            1e-6 * static_cast<double>(c->most_late_ns), c->holds.load(),
            1e-6 * static_cast<double>(c->held_ns));
    std::string late;
    for (const ChainStatistics* c : chains)
        if (c->late_starts > 0)
            late +=
                fmt::format("{} {} {}", late.empty() ? "" : ",", c->name, c->late_starts.load());
    if (!late.empty()) out += fmt::format("frames that started late:{}\n", late);
    out += fmt::format("overall deadline miss ratio {:.2f} %\n", 100 * overall_miss_ratio(chains));
    if (!guard.empty()) out += guard + "\n";
    return out;
}

std::string to_json(const std::vector<const ChainStatistics*>& chains, const std::string& mode,
                    const std::string& tripped, const std::string& guard,
                    const BystanderStatistics& bystanders, const GateStatistics& gates) {
    nlohmann::ordered_json root;
    root["format_version"] = 1;
    root["mode"] = mode;
    root["tripped"] = tripped;
    root["guard"] = guard;
    root["overall_miss_ratio"] = overall_miss_ratio(chains);
    root["bystanders"] = {{"seconds", bystanders.seconds},
                          {"often_s", bystanders.often_s},
                          {"busy_s", bystanders.busy_s}};
    root["gates"] = {{"closed", gates.closed},         {"opened_by_gpu", gates.opened_by_gpu},
                     {"refused", gates.refused},       {"parks", gates.parks},
                     {"gpu_rounds", gates.gpu_rounds}, {"gpu_round_us", gates.gpu_round_us}};
    root["chains"] = nlohmann::ordered_json::array();
    for (const ChainStatistics* c : chains)
        root["chains"].push_back(
            {{"name", c->name},
             {"guard", c->guard.load()},
             {"instances", c->instances.load()},
             {"finished", c->finished.load()},
             {"missed", c->missed.load()},
             {"exited", c->exited.load()},
             {"most_misses_in_a_row", c->most_misses_in_a_row.load()},
             {"most_late_ms", 1e-6 * static_cast<double>(c->most_late_ns)},
             {"launches", c->launches.load()},
             {"scheduled", c->scheduled.load()},
             {"as_planned", c->as_planned.load()},
             {"marks", c->marks.load()},
             {"marks_refused", c->marks_refused.load()},
             {"synchronisations", c->synchronisations.load()},
             {"holds", c->holds.load()},
             {"holds_opened", c->holds_opened.load()},
             {"resyncs", c->resyncs.load()},
             {"observed", c->observed.load()},
             {"unknown", c->unknown.load()},
             {"late_starts", c->late_starts.load()},
             {"early_frames", c->early.load()},
             {"lent", c->lent.load()},
             {"launching", c->launching.load()},
             {"launch_pace", c->launch_pace.load()},
             {"launch_slowdown", c->slowdown.load()},
             {"implausible_arrivals", c->implausible.load()},
             {"copies_cut", c->copies_cut.load()},
             {"implicit_syncs", c->implicit_syncs.load()},
             {"held_ns", c->held_ns.load()},
             {"paced_ns", c->paced_ns.load()},
             {"latency_mean_ms", mean_latency_ms(*c)},
             {"latency_max_ms", 1e-6 * static_cast<double>(c->latency_max_ns)}});
    return root.dump(2) + "\n";
}

}  // namespace urgengo::observe
