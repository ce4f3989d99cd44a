// SPDX-License-Identifier: Apache-2.0
//
// Names that others have written, made fit for a terminal and for JSON.
#pragma once

#include <string>
#include <string_view>

namespace urgengo::trace {

/// @returns the text with a '?' for each byte that is a control character, or of one, or not UTF-8:
///          a terminal obeys the former
std::string clean_text(std::string_view text);

}  // namespace urgengo::trace
