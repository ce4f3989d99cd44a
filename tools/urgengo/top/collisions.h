// SPDX-License-Identifier: Apache-2.0
//
// How often chains collide on the GPU (tools/trace/collision.h), as pages show it: they are looked
// at so many times a second, and the share of the looks of the last minute in which a chain was in
// a collision is the share of the time. The programs do nothing for it.
//
// @threads any
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tools/urgengo/page/page_reader.h"

namespace urgengo::cli {

/// @returns of each chain, whether it is in a collision now
std::vector<bool> colliding_chains(const PageReading& page);

class Collisions {
  public:
    static constexpr std::chrono::milliseconds kBetween{50};

    void looked(const PageReading& page, nanoseconds now);
    /// Sets what the looks of the last minute have seen in pages that were just read. From here on
    /// no others are followed.
    void set(std::vector<PageReading>& pages, nanoseconds now);
    /// A look at each page that was set last.
    void look();

  private:
    using Process = std::pair<std::uint64_t, std::uint32_t>;  // start, number
    struct Second {
        std::int64_t number = 0;  ///< on CLOCK_MONOTONIC
        std::vector<ChainReading::Collisions> chains;
    };

    std::mutex mutex_;
    std::map<Process, std::deque<Second>> seen_;
    std::vector<std::string> stems_;
};

/// Looks every Collisions::kBetween for as long as it lives.
class CollisionLooks {
  public:
    explicit CollisionLooks(Collisions& collisions);

  private:
    std::jthread thread_;
};

}  // namespace urgengo::cli
