// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/compare/live_frames.h"

namespace urgengo::cli {
namespace {

/// Records that may be written while they are read are those that come next.
constexpr std::uint64_t kSafe = abi::kFrameRing - abi::kFrameRing / 16;

}  // namespace

LiveFrames::LiveFrames(const PageReading& page) {
    for (const ChainReading& chain : page.chains) seen_.push_back(chain.ended);
}

bool LiveFrames::look(const PageReading& page, FrameBlocks& blocks) {
    bool has_all = true;
    for (std::size_t i = 0; i < seen_.size() && i < page.chains.size(); ++i) {
        const ChainReading& chain = page.chains[i];
        std::uint64_t fresh = chain.ended - seen_[i];
        seen_[i] = chain.ended;
        if (fresh > kSafe) {
            fresh = 0;
            has_all = false;
        }
        for (std::size_t n = chain.ring.size() - std::min<std::size_t>(fresh, chain.ring.size());
             n < chain.ring.size(); ++n) {
            const ChainReading::Frame& frame = chain.ring[n];
            if (frame.end.count() <= 0) continue;  // whatever wrote that
            blocks.add(i, {frame.end - frame.latency, frame.end, frame.missed});
        }
    }
    return has_all;
}

}  // namespace urgengo::cli
