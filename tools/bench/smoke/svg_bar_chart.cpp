// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/svg_bar_chart.h"

#include <fmt/format.h>

#include <algorithm>

namespace urgengo::cli {
namespace {

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

std::string grid(double end) {
    std::string svg;
    for (int i = 0; i <= kGridLines; ++i) {
        const double value = end * i / kGridLines;
        const double y = y_of(value, end);
        svg += fmt::format(
            "<line class=\"grid\" x1=\"{:.1f}\" x2=\"{:.1f}\" y1=\"{:.1f}\" y2=\"{:.1f}\"/>"
            "<text class=\"axis\" x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"end\">{:g} %</text>\n",
            kLeft, kWidth - kRight, y, y, kLeft - 6, y + 4, value);
    }
    return svg;
}

std::string bar(double x, double width, double value, double end, std::size_t series,
                const std::string& title) {
    // Half a unit at least, so that 0 % is a line and not nothing.
    const double height = std::max(0.5, kPlotHeight * value / end);
    return fmt::format(
        "<rect class=\"bar{}\" x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\">"
        "<title>{}: {:.1f} %</title></rect>\n",
        series, x, kTop + kPlotHeight - height, width, height, html_escape(title), value);
}

}  // namespace

std::string html_escape(const std::string& text) {
    std::string escaped;
    for (const char c : text) {
        switch (c) {
            case '&':
                escaped += "&amp;";
                break;
            case '<':
                escaped += "&lt;";
                break;
            case '>':
                escaped += "&gt;";
                break;
            case '"':
                escaped += "&quot;";
                break;
            default:
                escaped += c;
        }
    }
    return escaped;
}

std::string svg_bar_chart(const std::vector<std::string>& groups,
                          const std::vector<BarSeries>& series) {
    const double end = axis_end(series);
    std::string svg =
        fmt::format("<svg viewBox=\"0 0 {:g} {:g}\" role=\"img\">\n", kWidth, kHeight);
    svg += grid(end);
    const double group_width = kPlotWidth / static_cast<double>(groups.size());
    const double bar_width = group_width * kGroupFill / static_cast<double>(series.size());
    for (std::size_t g = 0; g < groups.size(); ++g) {
        const double left = kLeft + group_width * static_cast<double>(g);
        const double first = left + group_width * (1 - kGroupFill) / 2;
        for (std::size_t s = 0; s < series.size(); ++s) {
            svg += bar(first + bar_width * static_cast<double>(s), bar_width * 0.92,
                       series[s].values[g], end, s, groups[g] + ", " + series[s].name);
        }
        svg += fmt::format(
            "<text class=\"axis\" x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"middle\">{}</text>\n",
            left + group_width / 2, kHeight - 6, html_escape(groups[g]));
    }
    return svg + "</svg>\n";
}

}  // namespace urgengo::cli
