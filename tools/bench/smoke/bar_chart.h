// SPDX-License-Identifier: Apache-2.0
//
// Where grouped bars are drawn: one group a chain, one bar a row. report.html draws them.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace urgengo::cli {

struct BarSeries {
    std::string name;
    std::vector<double> values;  ///< per cent; one for each group
};

/// @returns width, height, and the lists grid, bars and groups, in units of the width
nlohmann::ordered_json bar_chart(const std::vector<std::string>& groups,
                                 const std::vector<BarSeries>& series);

}  // namespace urgengo::cli
