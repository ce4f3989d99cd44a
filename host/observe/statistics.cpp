// SPDX-License-Identifier: Apache-2.0
#include "host/observe/statistics.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <utility>

namespace urgengo::observe {
namespace {

double miss_ratio(const ChainStatistics& c) {
    return c.frames.instances
               ? static_cast<double>(c.frames.missed) / static_cast<double>(c.frames.instances)
               : 0;
}

double overall_miss_ratio(const std::vector<const ChainStatistics*>& chains) {
    double sum = 0;
    int active = 0;
    for (const ChainStatistics* c : chains)
        if (c->frames.instances) sum += miss_ratio(*c), ++active;
    return active ? sum / active : 0;
}

double mean_latency_ms(const ChainStatistics& c) {
    const std::uint64_t completed = c.frames.finished - c.frames.exited;
    return completed ? 1e-6 * static_cast<double>(c.frames.latency_sum_ns) /
                           static_cast<double>(completed)
                     : 0;
}

/// @returns a line; empty if nothing was compared
std::string guard_words(const ChainStatistics& c) {
    const sched::Finding& found = c.guard_found.finding;
    if (found.pairs == 0) return {};
    std::string words = fmt::format("guard: mean lateness of {}: {:.2f} as it was, {:.2f} with {}",
                                    c.name, found.usual, found.other, c.guard_found.with);
    if (found.pairs > 1) words += fmt::format(" ({:+.2f}..{:+.2f}, 95 %)", found.low, found.high);
    return words + "\n";
}

nlohmann::ordered_json guard_json(const ChainStatistics::GuardFound& found) {
    const sched::Finding& finding = found.finding;
    if (finding.pairs == 0) return nullptr;
    nlohmann::ordered_json told = {{"with", found.with},
                                   {"pairs", finding.pairs},
                                   {"usual", finding.usual},
                                   {"other", finding.other}};
    if (finding.pairs > 1) told["low"] = finding.low, told["high"] = finding.high;
    return told;
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
            c->name, c->frames.instances.load(), c->frames.missed.load(), 100 * miss_ratio(*c),
            c->frames.most_misses_in_a_row.load(), c->frames.exited.load(), mean_latency_ms(*c),
            1e-6 * static_cast<double>(c->frames.latency_max_ns),
            1e-6 * static_cast<double>(c->frames.most_late_ns), c->tasks.holds.load(),
            1e-6 * static_cast<double>(c->tasks.held_ns));
    const auto line = [&](const char* what, auto FrameCounters::*counter) {
        std::string counts;
        for (const ChainStatistics* c : chains)
            if (const auto count = (c->frames.*counter).load(); count > 0)
                counts += fmt::format("{} {} {}", counts.empty() ? "" : ",", c->name, count);
        if (!counts.empty()) out += fmt::format("{}:{}\n", what, counts);
    };
    line("frames that started late", &FrameCounters::late_starts);
    line("frames that were let alone, as launching was all that they waited for",
         &FrameCounters::stood_aside);
    for (const ChainStatistics* c : chains) {
        std::string causes;
        for (const CauseCount& cause : c->causes)
            causes += fmt::format("{} {} {}", causes.empty() ? "" : ",", cause.count,
                                  in_words(cause.cause, cause.behind));
        if (!causes.empty()) out += fmt::format("late frames of {}:{}\n", c->name, causes);
    }
    out += fmt::format("overall deadline miss ratio {:.2f} %\n", 100 * overall_miss_ratio(chains));
    if (!guard.empty()) out += guard + "\n";
    for (const ChainStatistics* c : chains) out += guard_words(*c);
    return out;
}

std::string to_json(const std::vector<const ChainStatistics*>& chains, const std::string& mode,
                    const std::string& tripped, const std::string& guard,
                    const BystanderStatistics& bystanders, const GateStatistics& gates,
                    const std::vector<std::string>& warnings) {
    nlohmann::ordered_json root;
    root["format_version"] = 1;
    root["mode"] = mode;
    root["tripped"] = tripped;
    root["guard"] = guard;
    root["warnings"] = warnings;
    root["overall_miss_ratio"] = overall_miss_ratio(chains);
    root["bystanders"] = {{"seconds", bystanders.seconds},
                          {"often_s", bystanders.often_s},
                          {"busy_s", bystanders.busy_s}};
    root["gates"] = {
        {"closed", gates.closed},           {"opened_by_gpu", gates.opened_by_gpu},
        {"refused", gates.refused},         {"parks", gates.parks},
        {"park_us", gates.park_us},         {"most_park_us", gates.most_park_us},
        {"parked_us", gates.parked_us},     {"most_parked_us", gates.most_parked_us},
        {"past_bound", gates.past_bound},   {"most_past_us", gates.most_past_us},
        {"host_rounds", gates.host_rounds}, {"opened_by_host", gates.opened_by_host},
        {"gpu_rounds", gates.gpu_rounds},   {"gpu_round_us", gates.gpu_round_us},
        {"forsaken", gates.forsaken},       {"urgent_laxity_us", gates.urgent_laxity_us}};
    root["chains"] = nlohmann::ordered_json::array();
    for (const ChainStatistics* c : chains) {
        auto causes = nlohmann::ordered_json::array();
        for (const CauseCount& cause : c->causes)
            causes.push_back({{"cause", to_word(cause.cause)},
                              {"behind", cause.behind},
                              {"frames", cause.count}});
        root["chains"].push_back(
            {{"name", c->name},
             {"guard", c->guard.load()},
             {"instances", c->frames.instances.load()},
             {"finished", c->frames.finished.load()},
             {"missed", c->frames.missed.load()},
             {"exited", c->frames.exited.load()},
             {"most_misses_in_a_row", c->frames.most_misses_in_a_row.load()},
             {"most_late_ms", 1e-6 * static_cast<double>(c->frames.most_late_ns)},
             {"launches", c->tasks.launches.load()},
             {"scheduled", c->tasks.scheduled.load()},
             {"as_planned", c->as_planned.load()},
             {"marks", c->tasks.marks.load()},
             {"marks_refused", c->tasks.marks_refused.load()},
             {"synchronisations", c->synchronisations.load()},
             {"holds", c->tasks.holds.load()},
             {"holds_opened", c->tasks.holds_opened.load()},
             {"resyncs", c->frames.resyncs.load()},
             {"observed", c->frames.observed.load()},
             {"stood_aside", c->frames.stood_aside.load()},
             {"unknown", c->tasks.unknown.load()},
             {"late_starts", c->frames.late_starts.load()},
             {"early_frames", c->frames.early.load()},
             {"lent", c->tasks.lent.load()},
             {"launching", c->launching.state.load()},
             {"launch_pace", c->launching.pace.load()},
             {"launch_slowdown", c->launching.slowdown.load()},
             {"launch_together", c->launching.together.load()},
             {"implausible_arrivals", c->frames.implausible.load()},
             {"copies_cut", c->copies_cut.load()},
             {"implicit_syncs", c->tasks.implicit_syncs.load()},
             {"held_ns", c->tasks.held_ns.load()},
             {"paced_ns", c->tasks.paced_ns.load()},
             {"latency_mean_ms", mean_latency_ms(*c)},
             {"latency_max_ms", 1e-6 * static_cast<double>(c->frames.latency_max_ns)},
             {"guard_found", guard_json(c->guard_found)},
             {"causes", std::move(causes)}});
    }
    // Names need not be UTF-8; replacing is better than throwing.
    return root.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace urgengo::observe
