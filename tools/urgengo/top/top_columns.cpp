// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/top/top_columns.h"

#include <algorithm>

namespace urgengo::cli {
namespace {

constexpr TopColumnLook kColumns[] = {
    {"chain", true, 0},  {"does", true, 1},      {"deadline", false, 14},    {"laxity", false, 2},
    {"", true, 11},      {"done", false, 15},    {"at", false, 4},           {"kernel", true, 9},
    {"prio", false, 6},  {"waits", true, 3},     {"frames", false, 16},      {"missed", false, 5},
    {"%", false, 7},     {"in row", false, 17},  {"p99 1min", false, 10},    {"% 1min", false, 12},
    {"guard", true, 13}, {"last miss", true, 8}, {"late because", true, 18},
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
    std::vector<TopColumn> fit;
    for (std::size_t i = 0; i < kNumTopColumns; ++i) fit.push_back(static_cast<TopColumn>(i));
    const auto drop_of = [](TopColumn column) {
        return kColumns[static_cast<std::size_t>(column)].drop;
    };
    const auto width = [&] {
        std::size_t sum = 0;
        for (const TopColumn column : fit) sum += widths[static_cast<std::size_t>(column)] + 1;
        return sum - 1;
    };
    while (fit.size() > 1 && width() > room)
        fit.erase(std::max_element(fit.begin(), fit.end(), [&](TopColumn a, TopColumn b) {
            return drop_of(a) < drop_of(b);
        }));
    return fit;
}

}  // namespace urgengo::cli
