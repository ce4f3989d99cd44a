// SPDX-License-Identifier: Apache-2.0
//
// Columns of text: the first to the left, all others to the right, as wide as they must be.
#pragma once

#include <string>
#include <vector>

namespace urgengo::cli {

class TextTable {
  public:
    void add_row(std::vector<std::string> cells) { rows_.push_back(std::move(cells)); }
    /// @returns one line a row, each ended by a newline, without trailing spaces
    std::string text() const;

  private:
    std::vector<std::vector<std::string>> rows_;
};

}  // namespace urgengo::cli
