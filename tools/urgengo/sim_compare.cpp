// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/sim_compare.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "host/config/file_text.h"
#include "host/config/json_cursor.h"
#include "tools/bench/smoke/bench_plan.h"
#include "tools/urgengo/sim_mixes.h"
#include "tools/urgengo/sim_rows.h"
#include "tools/urgengo/text_table.h"

namespace urgengo::cli {
namespace {

using config::JsonCursor;

constexpr double kMost = 1e6;

template <typename T, typename Of>
std::vector<T> each_once(const std::vector<MeasuredRun>& runs, Of of) {
    std::vector<T> list;
    for (const MeasuredRun& run : runs)
        if (std::find(list.begin(), list.end(), of(run)) == list.end()) list.push_back(of(run));
    return list;
}

/// Parameters are text.
double parameter(const JsonCursor& parameters, const char* name) {
    const std::string text = parameters.at(name).text();
    char* end = nullptr;
    const double value = std::strtod(text.c_str(), &end);
    if (text.empty() || *end != 0) parameters.at(name).fail("a number as text");
    return value;
}

/// @returns the name of the measured row that this one is compared with; empty: none
std::string counterpart(const std::string& row, const std::vector<std::string>& measured) {
    const auto has = [&](const std::string& name) {
        return std::find(measured.begin(), measured.end(), name) != measured.end();
    };
    if (has(row)) return row;
    const std::string preset = parse_row(row).preset;
    return has(preset) ? preset : "";
}

ComparedCell compare_cell(const BenchResults& simulated, const Measured& measured,
                          const std::string& row, const std::string& with, double f_a) {
    ComparedCell cell{row, f_a};
    for (const RunResult& run : simulated.runs) {
        if (run.row != row || run.f_a != f_a) continue;
        double sum = 0;
        int count = 0;
        for (const MeasuredRun& other : measured.runs) {
            if (other.row != with || other.f_a != f_a || other.seed != run.seed) continue;
            sum += other.miss_pct;
            ++count;
        }
        if (count == 0) continue;
        cell.simulated_pct += run.miss_pct;
        cell.measured_pct += sum / count;
        ++cell.seeds;
    }
    if (cell.seeds > 0) {
        cell.simulated_pct /= cell.seeds;
        cell.measured_pct /= cell.seeds;
    }
    return cell;
}

void rank(SimComparison& comparison) {
    const auto& cells = comparison.cells;
    for (std::size_t i = 0; i < cells.size(); ++i)
        for (std::size_t j = i + 1; j < cells.size(); ++j) {
            const double apart = cells[i].measured_pct - cells[j].measured_pct;
            if (cells[i].f_a != cells[j].f_a || std::abs(apart) <= SimComparison::kTold) continue;
            ++comparison.pairs;
            comparison.alike += (cells[i].simulated_pct - cells[j].simulated_pct) * apart > 0;
        }
}

}  // namespace

std::vector<std::string> Measured::rows() const {
    auto list = each_once<std::string>(runs, [](const MeasuredRun& run) { return run.row; });
    std::erase_if(list, [](const std::string& row) { return !check_sim_row(row).empty(); });
    return list;
}

std::vector<double> Measured::levels() const {
    return each_once<double>(runs, [](const MeasuredRun& run) { return run.f_a; });
}

std::vector<std::uint32_t> Measured::seeds() const {
    return each_once<std::uint32_t>(runs, [](const MeasuredRun& run) { return run.seed; });
}

namespace {

void read_smoke(const JsonCursor& root, Measured& measured) {
    const JsonCursor parameters = root.at("parameters");
    measured.seconds = parameter(parameters, "seconds");
    measured.f_d = parameter(parameters, "f_d");
    for (const JsonCursor& run : root.at("runs").items())
        measured.runs.push_back({run.at("row").text(), run.at("f_a").number(0, kMost),
                                 static_cast<std::uint32_t>(run.at("seed").integer(0, UINT32_MAX)),
                                 run.at("overall_miss_pct").number(0, 100)});
    if (measured.runs.empty()) root.at("runs").fail("at least one run");
}

}  // namespace

Result<Measured> read_measured(const std::string& path, const MeasuredChoice& choice) {
    const auto text = config::read_file(path);
    if (!text) return Error{text.error()};
    const auto document = config::parse_json(*text, path);
    if (!document) return Error{document.error()};
    config::JsonFault fault{path, {}};
    const JsonCursor root(*document, fault);
    Measured measured;
    measured.gpu = root.at("gpu").text();
    measured.commit = root.at("commit").text();
    measured.date_utc = root.at("date_utc").text();
    if (has_mixes(root))
        read_mixes(root, choice.chains, choice.beside_bystander, measured);
    else
        read_smoke(root, measured);
    if (!fault.message.empty()) return Error{fault.message};
    return measured;
}

SimComparison compare(const BenchResults& simulated, const Measured& measured) {
    SimComparison comparison;
    const auto rows =
        each_once<std::string>(measured.runs, [](const MeasuredRun& run) { return run.row; });
    for (const double f_a : simulated.levels)
        for (const std::string& row : simulated.rows) {
            const std::string with = counterpart(row, rows);
            if (with.empty()) continue;
            const ComparedCell cell = compare_cell(simulated, measured, row, with, f_a);
            if (cell.seeds > 0) comparison.cells.push_back(cell);
        }
    for (const ComparedCell& cell : comparison.cells)
        comparison.mean_absolute_difference +=
            std::abs(cell.difference()) / static_cast<double>(comparison.cells.size());
    rank(comparison);
    return comparison;
}

std::string format_comparison(const SimComparison& comparison, const Measured& measured) {
    if (comparison.cells.empty())
        return fmt::format("nothing to compare with {}: no row at the same f_a and seed\n",
                           measured.gpu);
    TextTable table;
    table.add_row({"miss %", "f_a", "simulated", "measured", "points more", "seeds"});
    for (const ComparedCell& cell : comparison.cells)
        table.add_row({cell.row, fmt::format("{}", cell.f_a),
                       fmt::format("{:.1f}", cell.simulated_pct),
                       fmt::format("{:.1f}", cell.measured_pct),
                       fmt::format("{:+.1f}", cell.difference()), std::to_string(cell.seeds)});
    return fmt::format(
        "{}\nmeasured: {}, {}, {}\nmean absolute difference: {:.2f} points\n"
        "rows in the same order, of pairs that are more than {} points apart: {} of {}\n",
        table.text(), measured.gpu, measured.commit, measured.date_utc,
        comparison.mean_absolute_difference, SimComparison::kTold, comparison.alike,
        comparison.pairs);
}

}  // namespace urgengo::cli
