// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/measure/overhead_bench.h"

#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "tools/bench/smoke/bench_table.h"
#include "tools/urgengo/text_table.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

struct Value {
    const char* key;
    double OverheadRun::*member;
};

constexpr Value kValues[] = {{"instances", &OverheadRun::instances},
                             {"launches", &OverheadRun::launches},
                             {"decisions", &OverheadRun::decisions},
                             {"deciding_median_us", &OverheadRun::deciding_median_us},
                             {"deciding_us", &OverheadRun::deciding_us},
                             {"added_us", &OverheadRun::added_us},
                             {"our_driver_us", &OverheadRun::our_driver_us},
                             {"held_us", &OverheadRun::held_us},
                             {"polling_us", &OverheadRun::polling_us}};

struct Line {
    double at_zero = 0, slope = 0, r_squared = 0;
};

/// Least squares.
Line line_through(const std::vector<std::pair<double, double>>& points) {
    double x_mean = 0, y_mean = 0;
    for (const auto& [x, y] : points) x_mean += x, y_mean += y;
    x_mean /= static_cast<double>(points.size());
    y_mean /= static_cast<double>(points.size());
    double xx = 0, xy = 0, yy = 0;
    for (const auto& [x, y] : points) {
        xx += (x - x_mean) * (x - x_mean);
        xy += (x - x_mean) * (y - y_mean);
        yy += (y - y_mean) * (y - y_mean);
    }
    const double slope = xy / xx;
    return {y_mean - slope * x_mean, slope, yy > 0 ? xy * xy / (xx * yy) : 1};
}

std::string describe(const char* what, const OverheadFit& fit) {
    return fmt::format(
        "{}: {:.2f} us + {:.3f} us a chain (R^2 {:.3f}); as chains to the {:.2f}: "
        "{}\n",
        what, fit.us_at_none, fit.us_a_chain, fit.r_squared, fit.exponent,
        fit.exponent <= 1 ? "no worse than linear" : "WORSE THAN LINEAR");
}

Json fit_json(const OverheadFit& fit) {
    return {{"us_at_none", fit.us_at_none},
            {"us_a_chain", fit.us_a_chain},
            {"r_squared", fit.r_squared},
            {"exponent", fit.exponent}};
}

bool can_be_fitted(const std::vector<OverheadPoint>& points, double OverheadRun::*value) {
    for (const OverheadPoint& point : points)
        if (point.of(value).median <= 0) return false;
    return points.size() >= 2;
}

}  // namespace

Result<OverheadRun> parse_own_time(const Json& own_time) {
    OverheadRun run;
    try {
        const Json& instances = own_time.at("instances");
        const auto mean = [&](const char* key) {
            return instances.at(key).at("mean").get<double>();
        };
        run.instances = instances.at("count").get<double>();
        run.launches = mean("launches");
        run.decisions = mean("decisions");
        run.deciding_median_us = instances.at("deciding_ns").at("p50").get<double>() / 1e3;
        run.deciding_us = mean("deciding_ns") / 1e3;
        run.added_us = mean("added_ns") / 1e3;
        run.our_driver_us = mean("our_driver_ns") / 1e3;
        run.held_us = mean("held_ns") / 1e3;
        run.polling_us = mean("polling_ns") / 1e3;
    } catch (const Json::exception& error) {
        return Error{std::string("the library's own time: ") + error.what()};
    }
    if (run.launches <= 0)
        return Error{
            "the library's own time: found no instance with a launch (a longer --seconds?)"};
    return run;
}

Spread OverheadPoint::of(double OverheadRun::*value) const {
    std::vector<double> values;
    for (const OverheadRun& run : rounds) values.push_back(run.*value);
    return spread(std::move(values));
}

OverheadFit fit(const std::vector<OverheadPoint>& points, double OverheadRun::*value) {
    std::vector<std::pair<double, double>> plain, logarithms;
    for (const OverheadPoint& point : points) {
        const double us = point.of(value).median;
        plain.emplace_back(point.chains, us);
        logarithms.emplace_back(std::log(point.chains), std::log(us));
    }
    const Line line = line_through(plain);
    return {line.at_zero, line.slope, line.r_squared, line_through(logarithms).slope};
}

std::string format_overhead(const std::vector<OverheadPoint>& points) {
    TextTable table;
    table.add_row({"chains", "instances", "launches", "decisions", "deciding us: median", "mean",
                   "goal", "ns a launch", "all added us", "ns a launch", "of it marks us",
                   "held ms", "polling us"});
    for (const OverheadPoint& point : points) {
        const OverheadRun& first = point.rounds.front();
        const Spread deciding = point.of(&OverheadRun::deciding_us);
        const bool judged = point.chains == kOverheadGoalChains;
        Spread held = point.of(&OverheadRun::held_us);
        held = {held.median / 1e3, held.min / 1e3, held.max / 1e3};
        table.add_row(
            {std::to_string(point.chains), format_spread(point.of(&OverheadRun::instances), 0),
             fmt::format("{:.0f}", first.launches),
             format_spread(point.of(&OverheadRun::decisions), 0),
             format_spread(point.of(&OverheadRun::deciding_median_us), 2),
             format_spread(deciding, 2),
             !judged                              ? ""
             : deciding.median <= kOverheadGoalUs ? "met"
                                                  : "NOT MET",
             fmt::format("{:.1f}", 1e3 * deciding.median / first.launches),
             format_spread(point.of(&OverheadRun::added_us), 1),
             fmt::format("{:.1f}", 1e3 * point.of(&OverheadRun::added_us).median / first.launches),
             format_spread(point.of(&OverheadRun::our_driver_us), 1), format_spread(held, 2),
             format_spread(point.of(&OverheadRun::polling_us), 1)});
    }
    std::string text = table.text();
    if (can_be_fitted(points, &OverheadRun::deciding_us))
        text += "\n" + describe("deciding (mean)", fit(points, &OverheadRun::deciding_us));
    if (can_be_fitted(points, &OverheadRun::added_us))
        text += describe("all added (mean)", fit(points, &OverheadRun::added_us));
    return text;
}

Json overhead_json(const std::vector<OverheadPoint>& points) {
    Json list = Json::array();
    for (const OverheadPoint& point : points) {
        Json entry = {{"chains", point.chains}, {"rounds", Json::array()}};
        for (const Value& value : kValues) {
            const Spread of = point.of(value.member);
            entry[value.key] = {{"median", of.median}, {"min", of.min}, {"max", of.max}};
        }
        for (const OverheadRun& run : point.rounds) {
            Json values;
            for (const Value& value : kValues) values[value.key] = run.*value.member;
            values["deciding_ns_a_launch"] = run.deciding_ns_a_launch();
            values["added_ns_a_launch"] = run.added_ns_a_launch();
            entry["rounds"].push_back(std::move(values));
        }
        list.push_back(std::move(entry));
    }
    Json fits = Json::object();
    for (const Value& value : {kValues[3], kValues[4], kValues[5]})
        if (can_be_fitted(points, value.member))
            fits[value.key] = fit_json(fit(points, value.member));
    return {{"points", std::move(list)}, {"fits", std::move(fits)}};
}

}  // namespace urgengo::cli
