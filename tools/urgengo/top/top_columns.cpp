// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/top/top_columns.h"

#include <algorithm>
#include <array>
#include <numeric>

namespace urgengo::cli {
namespace {

constexpr TopColumnLook kColumns[] = {
    {"chain", true, 0},
    {"does", true, 1},
    {"deadline", false, 14},
    {"laxity", false, 2},
    {"", true, 11},
    {"done", false, 15},
    {"at", false, 4},
    {"kernel", true, 9},
    {"prio", false, 6},
    {"waits", true, 3},
    {"frames", false, 16},
    {"missed", false, 5},
    {"%", false, 7},
    {"in row", false, 17},
    {"p99 1min", false, 10},
    {"% 1min", false, 12},
    {"collides %", false, 18},
    {"guard", true, 13},
    {"last miss", true, 8},
    {"late because", true, 19},
};
static_assert(std::size(kColumns) == kNumTopColumns);

}  // namespace

std::span<const TopColumnLook, kNumTopColumns> top_columns() {
    return kColumns;
}

std::vector<std::string> top_heads() {
    std::vector<std::string> heads;
    for (const TopColumnLook& column : kColumns) heads.emplace_back(column.head);
    return heads;
}

std::vector<TopColumn> columns_that_fit(const std::vector<std::size_t>& widths, std::size_t room) {
    std::array<std::size_t, kNumTopColumns> order{};
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::sort(order.begin(), order.end(),
              [](std::size_t a, std::size_t b) { return kColumns[a].place < kColumns[b].place; });
    std::vector<TopColumn> fit;
    std::size_t taken = 0;
    for (const std::size_t column : order) {
        const std::size_t width = widths[column] + (fit.empty() ? 0 : 1);
        if (!fit.empty() && (taken > room || width > room - taken)) continue;
        taken += width;
        fit.push_back(static_cast<TopColumn>(column));
    }
    std::sort(fit.begin(), fit.end());
    return fit;
}

}  // namespace urgengo::cli
