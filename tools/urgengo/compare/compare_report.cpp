// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/compare/compare_report.h"

#include <fmt/format.h>

#include <algorithm>

#include "tools/urgengo/text_table.h"

namespace urgengo::cli {
namespace {

using Measure = FrameBlocks::Measure;

/// Among the numbers of one row, by hand: how they are told.
std::string number(const ComparedRow& row, double value) {
    return fmt::format("{:.2f} {}", row.scale * value, row.unit);
}

std::string interval(const ComparedRow& row) {
    const Difference& d = *row.difference;
    return fmt::format("{:+.2f} [{:+.2f}, {:+.2f}]", row.scale * d.mean(), row.scale * d.low,
                       row.scale * d.high);
}

/// All measures are better if they are less.
std::string verdict(const ComparedRow& row, const Comparison& comparison) {
    if (!row.difference) return "too few pairs";
    if (row.measure == "missed" && row.frames_a + row.frames_b > 0 && row.missed_a == 0 &&
        row.missed_b == 0)
        return "none missed";
    if (!row.is_found()) return "no difference found";
    const bool b_is_less = row.difference->mean() < 0;
    return (b_is_less ? comparison.b : comparison.a) + " is better";
}

ComparedRow make_row(std::string of, std::string measure, std::string unit, double scale,
                     const std::vector<BlockPair>& pairs, std::uint64_t seed) {
    ComparedRow row{.of = std::move(of),
                    .measure = std::move(measure),
                    .unit = std::move(unit),
                    .scale = scale,
                    .pairs = pairs.size(),
                    .difference = difference(pairs, kConfidence, seed)};
    return row;
}

}  // namespace

bool Comparison::finds_difference() const {
    return std::any_of(rows.begin(), rows.end(),
                       [](const ComparedRow& row) { return row.is_found(); });
}

std::vector<ComparedRow> compare_blocks(const FrameBlocks& blocks,
                                        const std::vector<ComparedChain>& chains,
                                        bool counts_frames, std::uint64_t seed) {
    std::vector<ComparedRow> rows;
    std::vector<double> deadlines_ms;
    for (std::size_t i = 0; counts_frames && i < chains.size(); ++i) {
        const FramesOfBlock a = blocks.total(i, false), b = blocks.total(i, true);
        deadlines_ms.push_back(chains[i].deadline_ms);
        for (const auto measure : {Measure::kMissRatio, Measure::kLatency}) {
            const bool is_ratio = measure == Measure::kMissRatio;
            ComparedRow row =
                make_row(chains[i].name, is_ratio ? "missed" : "latency", is_ratio ? "%" : "ms",
                         is_ratio ? 100 : 1, blocks.pairs(i, measure), seed);
            row.frames_a = a.frames;
            row.frames_b = b.frames;
            row.missed_a = a.missed;
            row.missed_b = b.missed;
            rows.push_back(std::move(row));
        }
    }
    if (counts_frames) {
        rows.push_back(make_row("all chains", "missed", "%", 100,
                                blocks.pairs_of_all(Measure::kMissRatio, deadlines_ms), seed));
        rows.push_back(make_row("all chains", "latency", "% of deadline", 100,
                                blocks.pairs_of_all(Measure::kLatency, deadlines_ms), seed));
    }
    rows.push_back(make_row("process", "CPU", "cores", 1, blocks.pairs_of_cpu(), seed));
    tell_together(rows);
    return rows;
}

void tell_together(std::vector<ComparedRow>& rows) {
    std::vector<Difference*> together;
    for (ComparedRow& row : rows)
        if (row.difference) together.push_back(&*row.difference);
    adjust(together);
}

std::string to_text(const Comparison& comparison) {
    TextTable table;
    table.add_row({"of", "measure", "pairs", comparison.a, comparison.b,
                   fmt::format("{} less {} [95 %]", comparison.b, comparison.a), "p", ""});
    for (const ComparedRow& row : comparison.rows) {
        const bool is_known = row.difference.has_value();
        table.add_row(
            {row.of, row.measure, std::to_string(row.pairs),
             is_known ? number(row, row.difference->a) : "",
             is_known ? number(row, row.difference->b) : "", is_known ? interval(row) : "",
             is_known ? fmt::format("{:.3f}", row.difference->p) : "", verdict(row, comparison)});
    }
    std::string text = table.text();
    text +=
        comparison.finds_difference()
            ? fmt::format("{} and {} differ, at 95 % for all rows together", comparison.a,
                          comparison.b)
            : fmt::format("no difference found between {} and {}, at 95 % for all rows together",
                          comparison.a, comparison.b);
    text += fmt::format(" (seed {})\n", comparison.seed);
    if (!comparison.note.empty()) text += comparison.note + "\n";
    return text;
}

nlohmann::ordered_json to_json(const Comparison& comparison) {
    nlohmann::ordered_json json = {
        {"format_version", 1},       {"a", comparison.a},
        {"b", comparison.b},         {"seed", comparison.seed},
        {"confidence", kConfidence}, {"finds_difference", comparison.finds_difference()},
        {"note", comparison.note}};
    json["rows"] = nlohmann::ordered_json::array();
    for (const ComparedRow& row : comparison.rows) {
        nlohmann::ordered_json each = {
            {"of", row.of}, {"measure", row.measure}, {"unit", row.unit}, {"pairs", row.pairs}};
        if (row.frames_a + row.frames_b > 0) {
            each["frames"] = {row.frames_a, row.frames_b};
            each["missed"] = {row.missed_a, row.missed_b};
        }
        if (row.difference) {
            const Difference& d = *row.difference;
            each["value"] = {row.scale * d.a, row.scale * d.b};
            each["difference"] = row.scale * d.mean();
            each["interval"] = {row.scale * d.low, row.scale * d.high};
            each["p"] = d.p;
            each["adjusted_p"] = d.adjusted_p;
        }
        each["is_found"] = row.is_found();
        json["rows"].push_back(std::move(each));
    }
    return json;
}

}  // namespace urgengo::cli
