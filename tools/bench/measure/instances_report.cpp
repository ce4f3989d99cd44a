// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/measure/instances_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "tools/urgengo/text_table.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

double percent(std::uint64_t count, std::uint64_t of) {
    return of == 0 ? 0 : 100 * static_cast<double>(count) / static_cast<double>(of);
}

std::string count_text(std::uint64_t count, std::uint64_t of) {
    return fmt::format("{} ({:.2f} %)", count, percent(count, of));
}

std::string error_text(const std::vector<double>& errors_us) {
    if (errors_us.empty()) return "-";
    const ErrorSummary error = summarize_errors(errors_us);
    return fmt::format("{:.0f} / {:.0f} / {:.0f}", error.median_us, error.p95_abs_us,
                       error.max_abs_us);
}

void add_row(TextTable& table, const std::string& name, const InstanceMatch& match) {
    table.add_row({name, std::to_string(match.frames), std::to_string(match.detected),
                   count_text(match.false_starts, match.frames),
                   count_text(match.missed_starts, match.frames),
                   count_text(match.merged, match.frames),
                   count_text(match.resyncs, match.detected),
                   count_text(match.observed, match.detected), error_text(match.begin_error_us),
                   error_text(match.end_error_us), error_text(match.arrival_error_us)});
}

Json count_json(std::uint64_t count, std::uint64_t of) {
    return {{"count", count}, {"pct", percent(count, of)}};
}

Json error_json(const std::vector<double>& errors_us) {
    if (errors_us.empty()) return nullptr;
    const ErrorSummary error = summarize_errors(errors_us);
    return {{"instances", errors_us.size()},
            {"median_us", error.median_us},
            {"p95_abs_us", error.p95_abs_us},
            {"max_abs_us", error.max_abs_us}};
}

Json match_json(const InstanceMatch& match) {
    return {{"true_instances", match.frames},
            {"detected", match.detected},
            {"false_starts", count_json(match.false_starts, match.frames)},
            {"missed_starts", count_json(match.missed_starts, match.frames)},
            {"merged", count_json(match.merged, match.frames)},
            {"resyncs", count_json(match.resyncs, match.detected)},
            {"observed", count_json(match.observed, match.detected)},
            {"begin_error", error_json(match.begin_error_us)},
            {"end_error", error_json(match.end_error_us)},
            {"arrival_error", error_json(match.arrival_error_us)}};
}

}  // namespace

InstanceMatch InstancesLevel::overall() const {
    InstanceMatch sum;
    for (const auto& [name, match] : chains) sum += match;
    return sum;
}

ErrorSummary summarize_errors(const std::vector<double>& errors_us) {
    if (errors_us.empty()) return {};
    const std::size_t size = errors_us.size();
    std::vector<double> sorted = errors_us;
    std::sort(sorted.begin(), sorted.end());
    ErrorSummary summary;
    summary.median_us = (sorted[(size - 1) / 2] + sorted[size / 2]) / 2;
    for (double& error : sorted) error = std::abs(error);
    std::sort(sorted.begin(), sorted.end());
    summary.p95_abs_us = sorted[(size * 95 + 99) / 100 - 1];
    summary.max_abs_us = sorted.back();
    return summary;
}

std::string format_instances(const InstancesLevel& level) {
    TextTable table;
    table.add_row({"f_a " + fmt::format("{}", level.f_a), "true", "detected", "false starts",
                   "missed starts", "merged", "resyncs", "observed only", "begin", "end",
                   "arrival"});
    for (const auto& [name, match] : level.chains) add_row(table, name, match);
    add_row(table, "all", level.overall());
    return table.text();
}

Json instances_json(const InstancesLevel& level) {
    Json chains = Json::array();
    for (const auto& [name, match] : level.chains) {
        Json chain = {{"name", name}};
        chain.update(match_json(match));
        chains.push_back(std::move(chain));
    }
    return {{"f_a", level.f_a},
            {"overall_miss_pct", level.miss_pct},
            {"overall", match_json(level.overall())},
            {"chains", std::move(chains)}};
}

}  // namespace urgengo::cli
