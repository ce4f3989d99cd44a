// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/compare/frame_blocks.h"

#include <optional>

namespace urgengo::cli {

ComparedBlock& FrameBlocks::begin(bool is_b, nanoseconds when) {
    counts_.emplace_back(num_chains_);
    return blocks_.emplace_back(ComparedBlock{.is_b = is_b, .begin = when});
}

void FrameBlocks::add(std::size_t chain, const FrameSeen& frame) {
    for (std::size_t i = blocks_.size(); i-- > 0;) {
        const ComparedBlock& block = blocks_[i];
        if (frame.begin < block.begin + settle_) continue;
        if (block.end.count() > 0 && frame.end > block.end) return;
        FramesOfBlock& counts = counts_[i][chain];
        ++counts.frames;
        counts.missed += frame.missed;
        counts.latency_sum_ms += 1e-6 * static_cast<double>((frame.end - frame.begin).count());
        return;
    }
}

/// @param value  of a block, or nothing
template <typename Value>
std::vector<BlockPair> FrameBlocks::whole_pairs(Value&& value) const {
    std::vector<BlockPair> pairs;
    for (std::size_t i = 0; i + 1 < blocks_.size(); i += 2) {
        const bool is_whole =
            !blocks_[i].is_broken && !blocks_[i + 1].is_broken && blocks_[i + 1].end.count() > 0;
        if (!is_whole) continue;
        const std::size_t a = blocks_[i].is_b ? i + 1 : i;
        const std::size_t b = blocks_[i].is_b ? i : i + 1;
        const std::optional<double> of_a = value(a), of_b = value(b);
        if (of_a && of_b) pairs.push_back({*of_a, *of_b});
    }
    return pairs;
}

std::vector<BlockPair> FrameBlocks::pairs(std::size_t chain, Measure measure) const {
    return whole_pairs([&](std::size_t block) -> std::optional<double> {
        const FramesOfBlock& counts = counts_[block][chain];
        if (counts.frames == 0) return std::nullopt;
        return measure == Measure::kMissRatio ? counts.miss_ratio() : counts.latency_ms();
    });
}

std::vector<BlockPair> FrameBlocks::pairs_of_all(Measure measure,
                                                 const std::vector<double>& deadlines_ms) const {
    // A chain that has no frames in one of some blocks is in none of them.
    std::vector<bool> counts(num_chains_, true);
    for (std::size_t chain = 0; chain < num_chains_; ++chain)
        counts[chain] = pairs(chain, measure).size() ==
                        whole_pairs([](auto) { return std::optional(0.0); }).size();
    return whole_pairs([&](std::size_t block) -> std::optional<double> {
        double sum = 0;
        std::size_t chains = 0;
        for (std::size_t chain = 0; chain < num_chains_; ++chain) {
            if (!counts[chain]) continue;
            const FramesOfBlock& of = counts_[block][chain];
            sum += measure == Measure::kMissRatio ? of.miss_ratio()
                                                  : of.latency_ms() / deadlines_ms[chain];
            ++chains;
        }
        if (chains == 0) return std::nullopt;
        return sum / static_cast<double>(chains);
    });
}

std::vector<BlockPair> FrameBlocks::pairs_of_cpu() const {
    return whole_pairs([&](std::size_t block) -> std::optional<double> {
        const ComparedBlock& b = blocks_[block];
        return b.cpu_s / (1e-9 * static_cast<double>((b.end - b.begin).count()));
    });
}

FramesOfBlock FrameBlocks::total(std::size_t chain, bool is_b) const {
    FramesOfBlock total;
    (void)whole_pairs([&](std::size_t block) -> std::optional<double> {
        if (blocks_[block].is_b == is_b) {
            total.frames += counts_[block][chain].frames;
            total.missed += counts_[block][chain].missed;
            total.latency_sum_ms += counts_[block][chain].latency_sum_ms;
        }
        return 0;
    });
    return total;
}

}  // namespace urgengo::cli
