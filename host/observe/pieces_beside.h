// SPDX-License-Identifier: Apache-2.0
//
// Which pieces of others' work lie beside a frame's: compared in order, so that it takes as many
// steps as there are pieces and pairs of them, and never more than kMostPairs.
//
// Pure: no clock, no thread.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <utility>
#include <vector>

#include "host/observe/lost_time.h"

namespace urgengo::observe {

struct Span {
    nanoseconds begin{0}, end{0};
    nanoseconds length() const { return std::max(end - begin, nanoseconds{0}); }
};

inline Span common(const Span& a, const Span& b) {
    return {std::max(a.begin, b.begin), std::min(a.end, b.end)};
}

inline Span span_of(const ExecutedPiece& piece) {
    return {piece.begin, piece.end};
}

/// Spans of the frame, in order of their begins.
class SpansOfFrame {
  public:
    explicit SpansOfFrame(std::vector<Span> spans);
    static SpansOfFrame of(const std::vector<ExecutedPiece>& pieces);

    /// @returns how much there is to be compared, if the spans do not overlap
    std::size_t num_pairs(const std::vector<OthersSegment>& others) const;

    /// Calls act(index of span, segment, piece) for each of others' pieces that has a part in it.
    /// @returns how much was looked at, no more than kMostPairs
    template <typename Act>
    std::size_t for_each_beside(const std::vector<OthersSegment>& others, Act&& act) const {
        std::size_t num = 0;
        for (const OthersSegment& other : others) {
            auto piece = other.pieces.begin();
            const auto end = other.pieces.end();
            const auto [first, last] = beside(other);
            for (std::size_t i = first; i < last; ++i) {
                while (piece->end <= spans_[i].begin) ++piece;  // the last one ends later
                for (auto its = piece; its != end && its->begin < spans_[i].end; ++its) {
                    if (++num >= kMostPairs) return num;
                    act(i, other, *its);
                }
                if (++num >= kMostPairs) return num;
            }
        }
        return num;
    }

  private:
    /// @returns the first one that may lie beside it, and the one behind the last
    std::pair<std::size_t, std::size_t> beside(const OthersSegment& other) const;

    std::vector<Span> spans_;
    std::vector<nanoseconds> ends_;  ///< the latest up to each
};

}  // namespace urgengo::observe
