// SPDX-License-Identifier: Apache-2.0
//
// What frames tell of the block that they fell into. Pure.
//
// A frame counts for a block if all of it was in the block, and its first `settle` is over: what
// is on the GPU when the mode changes was launched in the other one. So one that spans a switch
// counts for none.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "tools/urgengo/compare/paired_blocks.h"

namespace urgengo::cli {

using std::chrono::nanoseconds;

/// Blocks 2n and 2n + 1 are a pair.
struct ComparedBlock {
    bool is_b = false;
    nanoseconds begin{0};    ///< the program had acted on the word
    nanoseconds end{0};      ///< before the next word was sent; 0: it goes on
    double cpu_s = 0;        ///< of the process meanwhile
    bool is_broken = false;  ///< cut short, or frames of it were not seen: its pair does not count
};

struct FrameSeen {
    nanoseconds begin{0}, end{0};
    bool missed = false;
};

/// Of one chain in one block.
struct FramesOfBlock {
    std::uint64_t frames = 0, missed = 0;
    double latency_sum_ms = 0;

    double miss_ratio() const { return static_cast<double>(missed) / static_cast<double>(frames); }
    double latency_ms() const { return latency_sum_ms / static_cast<double>(frames); }
};

class FrameBlocks {
  public:
    FrameBlocks(std::size_t num_chains, nanoseconds settle)
        : settle_(settle), num_chains_(num_chains) {}

    /// The last one must have an end.
    ComparedBlock& begin(bool is_b, nanoseconds when);
    ComparedBlock& last() { return blocks_.back(); }
    const std::vector<ComparedBlock>& blocks() const { return blocks_; }
    /// It has come to its end, or was dropped, at frame.end. In any order; by the end of the block
    /// after its own.
    void add(std::size_t chain, const FrameSeen& frame);
    /// @returns the block in which frames that begin now count; null: in none
    const FramesOfBlock& of(std::size_t block, std::size_t chain) const {
        return counts_[block][chain];
    }

    // Of pairs of which both blocks are whole:
    enum class Measure { kMissRatio, kLatency };
    /// @returns those in which the chain has frames in both
    std::vector<BlockPair> pairs(std::size_t chain, Measure measure) const;
    /// The mean over chains of the miss ratio; of the latency, as a share of the chain's deadline.
    /// @param deadlines_ms  by chain
    std::vector<BlockPair> pairs_of_all(Measure measure,
                                        const std::vector<double>& deadlines_ms) const;
    /// Cores that the process has kept busy.
    std::vector<BlockPair> pairs_of_cpu() const;
    /// Frames that count, of all blocks of whole pairs.
    FramesOfBlock total(std::size_t chain, bool is_b) const;

  private:
    template <typename Value>
    std::vector<BlockPair> whole_pairs(Value&& value) const;

    const nanoseconds settle_;
    const std::size_t num_chains_;
    std::vector<ComparedBlock> blocks_;
    std::vector<std::vector<FramesOfBlock>> counts_;  ///< by block, chain
};

}  // namespace urgengo::cli
