// SPDX-License-Identifier: Apache-2.0
//
// Grouped bars as inline SVG: one group a chain, one bar a row. Colours come from the page's CSS
// classes bar0, bar1, ...
#pragma once

#include <string>
#include <vector>

namespace urgengo::cli {

struct BarSeries {
    std::string name;
    std::vector<double> values;  ///< per cent; one for each group
};

/// @returns text that is safe inside HTML and inside its attributes
std::string html_escape(const std::string& text);

std::string svg_bar_chart(const std::vector<std::string>& groups,
                          const std::vector<BarSeries>& series);

}  // namespace urgengo::cli
