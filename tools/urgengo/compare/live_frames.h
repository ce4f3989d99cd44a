// SPDX-License-Identifier: Apache-2.0
//
// Frames of a running program, as its page tells of them: those that have ended since the last
// look.
#pragma once

#include <vector>

#include "tools/urgengo/compare/frame_blocks.h"
#include "tools/urgengo/page/page_reader.h"

namespace urgengo::cli {

class LiveFrames {
  public:
    /// Frames that have ended by now are none of ours.
    explicit LiveFrames(const PageReading& page);

    /// @returns false if a chain's ring has gone round since: frames of the block at hand are lost
    bool look(const PageReading& page, FrameBlocks& blocks);

  private:
    std::vector<std::uint64_t> seen_;  ///< by chain
};

}  // namespace urgengo::cli
