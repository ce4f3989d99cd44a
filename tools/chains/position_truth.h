// SPDX-License-Identifier: Apache-2.0
//
// A run with stamps: reads the clocks before and after it, samples positions meanwhile, and
// collects what is to be written. The file's own form says stamps_file.h.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "tools/chains/chain_runner.h"
#include "tools/chains/gpu.h"
#include "tools/chains/position_sampler.h"
#include "tools/chains/stamps_file.h"

namespace urgengo::chains {

class PositionTruth {
  public:
    /// @param sample_mean  of the distances between samples; 0: none are taken
    /// @param run_length   of the planned run: there is room for so many samples
    PositionTruth(const Gpu& gpu, const ug_hints& hints,
                  const std::vector<std::unique_ptr<ChainRunner>>& runners,
                  std::chrono::nanoseconds sample_mean, std::chrono::nanoseconds run_length,
                  std::uint32_t seed);

    /// Right before the chains start. @throws CudaError
    void begin();
    /// When all their work has ended.
    StampsFile end();

  private:
    const Gpu& gpu_;
    const std::vector<std::unique_ptr<ChainRunner>>& runners_;
    const std::chrono::nanoseconds sample_mean_;
    const std::uint32_t seed_;
    std::unique_ptr<PositionSampler> sampler_;
    std::vector<ClockReading> clock_;
};

}  // namespace urgengo::chains
