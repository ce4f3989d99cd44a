// SPDX-License-Identifier: Apache-2.0
//
// Which of a task's launches come before some point: of an event, of what is next on a stream, of
// what is known to have executed. Launches are counted a task, from 1, over all its instances; the
// program's order puts those of one stream one after the other, so that a number a stream says it
// all.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

namespace urgengo::progress {

/// Of one task at a time.
inline constexpr int kMaxStreams = 16;

struct Coverage {
    std::uint64_t all = 0;                        ///< every launch up to this one, on any stream
    std::array<std::uint64_t, kMaxStreams> on{};  ///< and those on stream i up to on[i]

    bool covers(int stream, std::uint64_t launch) const {
        return launch <= std::max(all, on[static_cast<std::size_t>(stream)]);
    }
    bool covers_all(std::uint64_t launched) const { return launched <= all; }
    void add(const Coverage& other) {
        all = std::max(all, other.all);
        for (std::size_t i = 0; i < on.size(); ++i) on[i] = std::max(on[i], other.on[i]);
    }
};

}  // namespace urgengo::progress
