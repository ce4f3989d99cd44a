// SPDX-License-Identifier: Apache-2.0
//
// A time and the mark that it is said of, in one word: the time to 256 ns, and in the low bits the
// mark's number, which tells apart as many as may be under way. 0: nothing is said.
#pragma once

#include <chrono>
#include <cstdint>

#include "urgengo/abi/shared_page.h"

namespace urgengo::model {

class MarkedTime {
  public:
    static constexpr std::int64_t word(std::chrono::nanoseconds time, std::uint32_t mark) {
        return (time.count() & ~kMarkBits) | (mark & kMarkBits);
    }
    /// @returns whether it says something, of this mark
    static constexpr bool is_of(std::int64_t word, std::uint32_t mark) {
        return word != 0 && (word & kMarkBits) == (mark & kMarkBits);
    }
    static constexpr std::chrono::nanoseconds time(std::int64_t word) {
        return std::chrono::nanoseconds(word & ~kMarkBits);
    }

  private:
    static constexpr std::int64_t kMarkBits = 0xff;
    static_assert(abi::kMarkRing <= kMarkBits, "so many may be under way");
};

}  // namespace urgengo::model
