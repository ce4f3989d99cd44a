// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/bar_chart.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kWidth = 760, kHeight = 230;
constexpr double kLeft = 44, kRight = 8, kTop = 16, kBottom = 24;
constexpr double kPlotWidth = kWidth - kLeft - kRight;
constexpr double kPlotHeight = kHeight - kTop - kBottom;
constexpr double kGroupFill = 0.72;  // share of a group's width that bars take
constexpr int kGridLines = 4;

/// The smallest round number of per cent that all values fit under.
double axis_end(const std::vector<BarSeries>& series) {
    double largest = 0;
    for (const BarSeries& s : series) {
        for (const double value : s.values) largest = std::max(largest, value);
    }
    for (const double end : {4.0, 8.0, 20.0, 40.0, 60.0, 80.0}) {
        if (largest <= end) return end;
    }
    return 100;
}

double y_of(double value, double end) {
    return kTop + kPlotHeight * (1 - value / end);
}

std::string tenths(double value) {
    return fmt::format("{:.1f}", value);
}

Json grid(double end) {
    Json lines = Json::array();
    for (int i = 0; i <= kGridLines; ++i) {
        const double value = end * i / kGridLines;
        const double y = y_of(value, end);
        lines.push_back({{"left", tenths(kLeft)},
                         {"right", tenths(kWidth - kRight)},
                         {"y", tenths(y)},
                         {"label_x", tenths(kLeft - 6)},
                         {"label_y", tenths(y + 4)},
                         {"value", fmt::format("{:g}", value)}});
    }
    return lines;
}

}  // namespace

Json bar_chart(const std::vector<std::string>& groups, const std::vector<BarSeries>& series) {
    const double end = axis_end(series);
    const double group_width = kPlotWidth / static_cast<double>(groups.size());
    const double bar_width = group_width * kGroupFill / static_cast<double>(series.size());
    Json bars = Json::array(), names = Json::array();
    for (std::size_t g = 0; g < groups.size(); ++g) {
        const double left = kLeft + group_width * static_cast<double>(g);
        const double first = left + group_width * (1 - kGroupFill) / 2;
        for (std::size_t s = 0; s < series.size(); ++s) {
            const double value = series[s].values[g];
            // Half a unit at least, so that 0 % is a line and not nothing.
            const double height = std::max(0.5, kPlotHeight * value / end);
            bars.push_back({{"series", s},
                            {"x", tenths(first + bar_width * static_cast<double>(s))},
                            {"y", tenths(kTop + kPlotHeight - height)},
                            {"width", tenths(bar_width * 0.92)},
                            {"height", tenths(height)},
                            {"group", groups[g]},
                            {"name", series[s].name},
                            {"value", tenths(value)}});
        }
        names.push_back({{"x", tenths(left + group_width / 2)},
                         {"y", tenths(kHeight - 6)},
                         {"name", groups[g]}});
    }
    return {{"width", fmt::format("{:g}", kWidth)},
            {"height", fmt::format("{:g}", kHeight)},
            {"grid", grid(end)},
            {"bars", std::move(bars)},
            {"groups", std::move(names)}};
}

}  // namespace urgengo::cli
