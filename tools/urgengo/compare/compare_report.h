// SPDX-License-Identifier: Apache-2.0
//
// What `urgengo compare` has found, for people and for scripts. Pure.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "tools/urgengo/compare/frame_blocks.h"

namespace urgengo::cli {

inline constexpr double kConfidence = 0.95;

struct ComparedRow {
    std::string of;       ///< chain, "all chains" or "process"
    std::string measure;  ///< "missed", "latency", "CPU" or "time"
    std::string unit;     ///< "%", "ms", "cores", "s"
    double scale = 1;     ///< of the numbers, for people
    std::size_t pairs = 0;
    std::optional<Difference> difference;  ///< nothing: too few pairs
    std::uint64_t frames_a = 0, frames_b = 0, missed_a = 0, missed_b = 0;

    bool is_found() const { return difference && difference->adjusted_p <= 1 - kConfidence; }
};

struct ComparedChain {
    std::string name;
    double deadline_ms = 0;
};

struct Comparison {
    std::string a, b;  ///< modes, or "bare"
    std::uint64_t seed = 0;
    std::string note;  ///< why it came to an end before its time; empty: it did not
    std::vector<ComparedRow> rows;

    bool finds_difference() const;
};

/// @param counts_frames  false: one of the two modes counts none, so there is the CPU alone
std::vector<ComparedRow> compare_blocks(const FrameBlocks& blocks,
                                        const std::vector<ComparedChain>& chains,
                                        bool counts_frames, std::uint64_t seed);
/// Adjusts what they say for their number.
void tell_together(std::vector<ComparedRow>& rows);

/// @returns a table and a line that says what it comes to
std::string to_text(const Comparison& comparison);
nlohmann::ordered_json to_json(const Comparison& comparison);

}  // namespace urgengo::cli
