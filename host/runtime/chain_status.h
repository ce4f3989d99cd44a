// SPDX-License-Identifier: Apache-2.0
//
// What the status page (observe/status_page.h) tells of chains: written when a frame comes or ends,
// never by a launch. Counters of launches and holds are as of the last frame that ended.
//
// @threads any; takes no lock. Two frames of one chain that end at the same time may be counted in
//          either order
#pragma once

#include <atomic>
#include <cstdint>
#include <vector>

#include "host/runtime/common.h"

namespace urgengo::runtime {

class ChainStatus {
  public:
    /// @param common  outlives it
    explicit ChainStatus(Common& common);

    void arrived(const ChainState& chain);
    void ended(const ChainState& chain, nanoseconds latency, const observe::Cause& cause,
               nanoseconds now);
    /// A frame of it counts as missed, and never came to its end.
    void dropped(const ChainState& chain);

  private:
    /// Records of frames: each has one of its own, and readers see it once all before are there.
    struct Records {
        std::atomic<std::uint64_t> claimed{0}, written{0};
    };

    /// For our own log.
    void note_miss(const ChainState& chain, std::uint64_t number, nanoseconds latency,
                   const observe::Cause& cause) const;
    void count(const ChainState& chain, abi::ChainStatus& status) const;

    Common& common_;
    std::vector<Records> records_;  ///< by chain
};

}  // namespace urgengo::runtime
