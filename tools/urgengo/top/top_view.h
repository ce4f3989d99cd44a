// SPDX-License-Identifier: Apache-2.0
//
// What `urgengo top` shows of processes: lines of cells, in an order that the user chooses, from
// what their pages tell. No terminal here: the screen, and tests, take the lines from it.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "tools/urgengo/page/page_reader.h"
#include "tools/urgengo/top/top_columns.h"

namespace urgengo::cli {

/// By what chains are ordered: kUrgency: those that work on a frame, the least laxity first.
enum class TopOrder { kUrgency, kName, kMissed, kP99, kHeld };
/// @returns "urgency", "name", "missed", "p99", "held"
const char* to_word(TopOrder order);
std::optional<TopOrder> top_order(std::string_view word);
TopOrder next(TopOrder order);

struct TopOptions {
    TopOrder order = TopOrder::kUrgency;
    bool reverse = false;
    bool tasks = false;    ///< under each chain, its tasks
    std::string filter{};  ///< chains whose names hold it
};

struct TopLine {
    enum class Look { kPlain, kHead, kProcess, kLate, kHeld, kIdle, kTask };
    Look look = Look::kPlain;
    std::vector<std::string> cells;  ///< by TopColumn; kProcess: one, over all columns
};

/// @returns the heads; a line a process, and below it one a chain, perhaps with its tasks
std::vector<TopLine> top_lines(const std::vector<PageReading>& pages, const TopOptions& options);

/// @returns widths of the columns, in characters: what stands in them fits
std::vector<std::size_t> top_widths(const std::vector<TopLine>& lines);

/// @param shown  columns, in their order
/// @returns the line's text, in columns of these widths, without spaces at its end
std::string top_text(const TopLine& line, const std::vector<std::size_t>& widths,
                     const std::vector<TopColumn>& shown);

/// @returns a bar: how much of its deadline a frame has left, "[####    ]"; empty, if none is
///          under way
std::string laxity_bar(nanoseconds laxity, nanoseconds deadline);

/// @returns the same for scripts; names of its fields: docs/configuration.md
nlohmann::ordered_json top_json(const std::vector<PageReading>& pages);

}  // namespace urgengo::cli
