// SPDX-License-Identifier: Apache-2.0
//
// "Did you mean ...?" for misspelt keys and words.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace urgengo::config {

/// @returns the candidate at the smallest edit distance from `word`, if that is at most 2 and less
///          than the word's length; else empty
std::string nearest_word(std::string_view word, const std::vector<std::string>& candidates);

}  // namespace urgengo::config
