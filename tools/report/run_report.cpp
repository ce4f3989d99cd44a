// SPDX-License-Identifier: Apache-2.0
#include "tools/report/run_report.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "tools/trace/csv_field.h"
#include "tools/trace/run_json.h"

namespace urgengo::report {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kMostNested = 64;

Json ratio_json(const MissRatio& ratio) {
    return {
        {"pct", 100 * ratio.ratio}, {"low_pct", 100 * ratio.low}, {"high_pct", 100 * ratio.high}};
}

Json chain_json(const ChainNumbers& chain, bool whole) {
    const trace::ChainSummary& s = chain.summary;
    Json told = {{"name", s.name},
                 {"deadline_ms", trace::to_ms(s.deadline_ns)},
                 {"frames", s.frames},
                 {"ended", s.ended},
                 {"late", s.late},
                 {"exited", s.exited},
                 {"dropped", s.dropped},
                 {"missed", ratio_json(chain.misses)},
                 {"median_ms", chain.percentile_ms(0.5)},
                 {"p95_ms", chain.percentile_ms(0.95)},
                 {"p99_ms", chain.percentile_ms(0.99)},
                 {"max_ms", chain.percentile_ms(1)},
                 {"holds", s.holds},
                 {"held_ms", trace::to_ms(s.held_ns)},
                 {"paced_ms", trace::to_ms(s.paced_ns)}};
    told["causes"] = Json::array();
    for (const observe::CauseCount& cause : s.causes)
        told["causes"].push_back({{"cause", observe::to_word(cause.cause)},
                                  {"words", observe::in_words(cause.cause, cause.behind)},
                                  {"behind", cause.behind},
                                  {"frames", cause.count}});
    if (whole) told["latencies_ms"] = chain.latencies_ms;
    return told;
}

Json bins_json(const RunNumbers& numbers) {
    Json bins = Json::array();
    for (const TimeBin& bin : numbers.bins) {
        Json missed = Json::object();
        for (const auto& [cause, count] : bin.missed) missed[observe::to_word(cause)] = count;
        Json told = {{"begin_s", bin.begin_s}, {"over", bin.over}, {"missed", std::move(missed)}};
        if (bin.cpu_cores >= 0) told["cpu_cores"] = bin.cpu_cores;
        bins.push_back(std::move(told));
    }
    return bins;
}

Json gpu_json(const GpuSharing& gpu) {
    const auto pct = [&](std::int64_t ns) {
        return gpu.span_ns > 0 ? 100 * static_cast<double>(ns) / static_cast<double>(gpu.span_ns)
                               : 0.0;
    };
    Json by_chains = Json::array(), collisions = Json::array();
    for (const std::int64_t ns : gpu.by_chains_ns) by_chains.push_back(pct(ns));
    for (const std::int64_t ns : gpu.collisions_ns) collisions.push_back(pct(ns));
    return {{"busy_pct", 100 * gpu.busy_share()},
            {"planned_pct", pct(gpu.planned_ns)},
            {"collision_pct", 100 * gpu.collision_share()},
            {"by_chains_pct", std::move(by_chains)},
            {"collisions_pct", std::move(collisions)}};
}

Json miss_json(const trace::Run& run, const MissStory& miss) {
    Json rows = Json::array(), bars = Json::array();
    for (const std::string& row : miss.window.rows) rows.push_back(row);
    for (const Bar& bar : miss.window.bars)
        bars.push_back({{"kind", static_cast<int>(bar.kind)},
                        {"row", bar.row},
                        {"begin_ms", bar.begin_ms},
                        {"end_ms", bar.end_ms},
                        {"words", bar.words}});
    return {{"name", miss.name},
            {"words", miss.words},
            {"story", trace::story_json(miss.lines)},
            {"held_behind", trace::times_json(run, miss.held_behind)},
            {"meanwhile", trace::times_json(run, miss.meanwhile)},
            {"window",
             {{"begin_ms", miss.window.begin_ms},
              {"end_ms", miss.window.end_ms},
              {"deadline_ms", miss.window.deadline_ms},
              {"ended_ms", miss.window.ended_ms},
              {"rows", std::move(rows)},
              {"bars", std::move(bars)}}}};
}

Json conditions_json(const trace::Run& run) {
    const Conditions conditions = conditions_of(run);
    Json facts = Json::array();
    for (const auto& [name, value] : conditions.facts)
        facts.push_back({{"name", name}, {"value", value}});
    return {{"facts", std::move(facts)}, {"config", conditions.config}};
}

/// As the simulated GPU calls itself (tools/simgpu).
bool is_simulated(const trace::Run& run) {
    return run.gpu.find("Simulated") != std::string::npos;
}

Json run_json(const ReportedRun& reported, bool whole) {
    const trace::Run& run = reported.run;
    const RunNumbers& numbers = reported.numbers;
    Json told = {{"label", reported.label},
                 {"program", run.program},
                 {"pid", run.process},
                 {"date", trace::date_of(run, run.begin_ns)},
                 {"seconds", numbers.seconds},
                 {"is_simulated", is_simulated(run)},
                 {"records", run.records.size()},
                 {"overwritten", run.overwritten},
                 {"lost", run.lost},
                 {"warnings", run.warnings},
                 {"missed", ratio_json(numbers.misses)},
                 {"mean_missed_pct", 100 * numbers.mean_miss_ratio}};
    if (numbers.cpu_cores >= 0) told["cpu_cores"] = numbers.cpu_cores;
    if (numbers.gpu.is_known) told["gpu"] = gpu_json(numbers.gpu);
    if (numbers.gates.has_any()) told["gates"] = trace::gates_words(numbers.gates);
    told["chains"] = Json::array();
    for (const ChainNumbers& chain : numbers.chains)
        told["chains"].push_back(chain_json(chain, whole));
    told["bin_s"] = numbers.bin_s;
    told["over_time"] = bins_json(numbers);
    told["conditions"] = conditions_json(run);
    if (!whole) return told;
    told["misses"] = Json::array();
    for (const MissStory& miss : reported.misses) told["misses"].push_back(miss_json(run, miss));
    return told;
}

}  // namespace

ReportedRun report_run(std::string label, trace::Run run, std::size_t most_misses) {
    ReportedRun reported{std::move(label), std::move(run), {}, {}};
    const trace::RunStory story = trace::tell(reported.run);
    reported.numbers = measure(reported.run, story);
    for (const std::size_t frame : choose_misses(reported.run, story, most_misses))
        reported.misses.push_back({frame, trace::frame_name(reported.run, story.frames[frame]),
                                   trace::outcome_words(reported.run, story.frames[frame]),
                                   trace::frame_story(reported.run, story, frame),
                                   trace::held_behind(story, frame), trace::meanwhile(story, frame),
                                   miss_window(reported.run, story, frame)});
    return reported;
}

Conditions conditions_of(const trace::Run& run) {
    Conditions conditions;
    const auto add = [&](const std::string& name, const std::string& value) {
        if (!value.empty()) conditions.facts.emplace_back(name, value);
    };
    add("GPU", run.gpu);
    // What is nested deeper is left out: printing it takes stack for each level.
    const auto is_flat = [](int depth, Json::parse_event_t, Json&) { return depth <= kMostNested; };
    const Json told = Json::parse(run.conditions, is_flat, false);
    if (!told.is_object()) return conditions;
    for (const auto& [name, value] : told.items()) {
        if (name == "kernels") continue;  // thousands
        if (name == "config")
            conditions.config = value.dump(2, ' ', false, Json::error_handler_t::replace);
        else
            add(name, value.is_string() ? value.get<std::string>() : value.dump());
    }
    return conditions;
}

Json to_json(const std::vector<ReportedRun>& runs, bool whole) {
    Json root = {{"format_version", 1}};
    root["causes"] = Json::array();
    for (std::size_t i = 1; i < observe::kNumCauses; ++i) {
        const auto cause = static_cast<abi::MissCause>(i);
        root["causes"].push_back(
            {{"cause", observe::to_word(cause)}, {"words", observe::in_words(cause, "")}});
    }
    if (whole) {
        root["bar_kinds"] = Json::array();
        for (const BarKind kind : kBarKinds) root["bar_kinds"].push_back(in_words(kind));
    }
    root["runs"] = Json::array();
    for (const ReportedRun& run : runs) root["runs"].push_back(run_json(run, whole));
    return root;
}

std::string to_csv(const std::vector<ReportedRun>& runs) {
    std::string text =
        "run,chain,deadline_ms,frames,ended,late,exited,dropped,missed_pct,missed_low_pct,"
        "missed_high_pct,median_ms,p95_ms,p99_ms,max_ms,held_ms,paced_ms,late_most_often\n";
    for (const ReportedRun& run : runs)
        for (const ChainNumbers& chain : run.numbers.chains) {
            const trace::ChainSummary& s = chain.summary;
            text += fmt::format(
                "{},{},{:.3f},{},{},{},{},{},{:.3f},{:.3f},{:.3f},{:.3f},{:.3f},{:.3f},{:.3f},"
                "{:.3f},{:.3f},{}\n",
                trace::csv_field(run.label), trace::csv_field(s.name), trace::to_ms(s.deadline_ns),
                s.frames, s.ended, s.late, s.exited, s.dropped, 100 * chain.misses.ratio,
                100 * chain.misses.low, 100 * chain.misses.high, chain.percentile_ms(0.5),
                chain.percentile_ms(0.95), chain.percentile_ms(0.99), chain.percentile_ms(1),
                trace::to_ms(s.held_ns), trace::to_ms(s.paced_ns),
                s.causes.empty()
                    ? ""
                    : trace::csv_field(observe::in_words(s.causes[0].cause, s.causes[0].behind)));
        }
    return text;
}

}  // namespace urgengo::report
