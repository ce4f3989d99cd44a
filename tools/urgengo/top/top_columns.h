// SPDX-License-Identifier: Apache-2.0
//
// The columns of `urgengo top`: what they are called, and which of them there is room for. On 80
// columns of a terminal what tells of the moment stays; what is wider shows more.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace urgengo::cli {

/// In the order in which they are shown.
enum class TopColumn {
    kChain,
    kDoes,
    kDeadline,
    kLaxity,
    kBar,
    kDone,
    kKernel,
    kName,
    kPriority,
    kWaits,
    kFrames,
    kMissed,
    kMissedShare,
    kInRow,
    kP99,
    kLately,
    kCollides,
    kGuard,
    kLastMiss,
    kCauses,
    kCount
};
inline constexpr std::size_t kNumTopColumns = static_cast<std::size_t>(TopColumn::kCount);

struct TopColumnLook {
    const char* head;
    bool is_left;  ///< what stands in it begins at its left edge
    int place;     ///< the smallest gets room first
};

/// By TopColumn.
std::span<const TopColumnLook, kNumTopColumns> top_columns();
/// @returns what stands above them
std::vector<std::string> top_heads();

/// @param widths  of all columns; between two there is a space
/// @returns those that fit into `room` characters, in their order: each in its place's turn, if
/// there
///          is room for it then; the chain's always
std::vector<TopColumn> columns_that_fit(const std::vector<std::size_t>& widths, std::size_t room);

}  // namespace urgengo::cli
