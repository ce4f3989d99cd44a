// SPDX-License-Identifier: Apache-2.0
//
// What the GPU did when, as far as marks vouch for it: each GPU segment of a task in pieces, from
// one mark to the next.
//
//  1 A mark tells that so many launches of the instance have executed, and when on the GPU's clock.
//    So the launches between two marks have executed between their times: at most so long, and
//    together with whatever else was on the GPU then.
//  2 The first piece begins with its segment, whose launches come later than that. The last one
//    ends with it, where its end is a wait for all of it.
//  3 A mark may be seen after its segment's end. Where its time on the GPU's clock is not known, or
//    makes no sense, the piece ends when the mark was seen.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tools/trace/run_story.h"

namespace urgengo::trace {

struct RunPiece {
    std::size_t task = 0;
    std::size_t frame = kNoFrame;
    std::uint16_t stream = 0;  ///< as in records; 0: not known
    std::int64_t begin_ns = 0, end_ns = 0;
    std::uint32_t first_launch = 0, end_launch = 0;  ///< of the instance: [first, end)
    bool is_on_gpu_clock = false;                    ///< its end is
};

/// @returns in the order of their begins
std::vector<RunPiece> gpu_pieces(const Run& run, const RunStory& story);

/// @returns "launch 3", "launches 0..3"
std::string launches_words(const RunPiece& piece);

}  // namespace urgengo::trace
