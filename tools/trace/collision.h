// SPDX-License-Identifier: Apache-2.0
//
// What a collision is, of chains that are on the GPU at a time: a chain executes at the same or a
// higher priority than one whose frame has an earlier deadline. It is of both. By deadlines: the
// laxity that UrgenGo itself goes by is not known from one moment to the next.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace urgengo::trace {

/// A chain that is on the GPU, by the most urgent of its tasks there.
struct ChainOnGpu {
    std::int64_t deadline_ns = 0;
    int priority = 0;  ///< as the driver takes it: the smallest goes first
};

/// @returns of each, whether it is in a collision with another one
std::vector<bool> colliding(std::span<const ChainOnGpu> chains);

}  // namespace urgengo::trace
