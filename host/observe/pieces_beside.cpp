// SPDX-License-Identifier: Apache-2.0
#include "host/observe/pieces_beside.h"

namespace urgengo::observe {

SpansOfFrame::SpansOfFrame(std::vector<Span> spans) : spans_(std::move(spans)) {
    ends_.reserve(spans_.size());
    nanoseconds latest = nanoseconds::min();
    for (const Span& span : spans_) ends_.push_back(latest = std::max(latest, span.end));
}

SpansOfFrame SpansOfFrame::of(const std::vector<ExecutedPiece>& pieces) {
    std::vector<Span> spans;
    spans.reserve(pieces.size());
    for (const ExecutedPiece& piece : pieces) spans.push_back(span_of(piece));
    return SpansOfFrame(std::move(spans));
}

std::pair<std::size_t, std::size_t> SpansOfFrame::beside(const OthersSegment& other) const {
    if (other.pieces.empty()) return {0, 0};
    const auto begins_before = [](const Span& span, nanoseconds time) { return span.begin < time; };
    const auto first = std::upper_bound(ends_.begin(), ends_.end(), other.pieces.front().begin);
    const auto behind =
        std::lower_bound(spans_.begin(), spans_.end(), other.pieces.back().end, begins_before);
    return {static_cast<std::size_t>(first - ends_.begin()),
            static_cast<std::size_t>(behind - spans_.begin())};
}

std::size_t SpansOfFrame::num_pairs(const std::vector<OthersSegment>& others) const {
    std::size_t num = 0;
    for (const OthersSegment& other : others)
        if (const auto [first, last] = beside(other); first < last)
            num += other.pieces.size() + last - first;
    return num;
}

}  // namespace urgengo::observe
