// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/position_truth.h"

#include <algorithm>

#include "tools/chains/clock_reading.h"

namespace urgengo::chains {

namespace {

/// Frames may go on for long after the last has arrived.
constexpr double kLongerRun = 1.5;
constexpr std::size_t kLeastRoom = 1000;
constexpr std::size_t kMostRoom = 500'000;

}  // namespace

PositionTruth::PositionTruth(const Gpu& gpu, const ug_hints& hints,
                             const std::vector<std::unique_ptr<ChainRunner>>& runners,
                             std::chrono::nanoseconds sample_mean,
                             std::chrono::nanoseconds run_length, std::uint32_t seed)
    : gpu_(gpu), runners_(runners), sample_mean_(sample_mean), seed_(seed) {
    if (sample_mean.count() == 0) return;
    std::vector<PositionSampler::Target> targets;
    for (const auto& runner : runners)
        for (std::size_t i = 0; i < runner->num_stages(); i++)
            targets.push_back(runner->sampled_stage(i));
    const double wakes = static_cast<double>(run_length.count()) /
                         static_cast<double>(sample_mean.count()) * kLongerRun;
    const double room = std::min(wakes * static_cast<double>(targets.size()), double(kMostRoom));
    sampler_ = std::make_unique<PositionSampler>(
        hints, std::move(targets), sample_mean,
        std::max(static_cast<std::size_t>(room), kLeastRoom), seed);
}

void PositionTruth::begin() {
    clock_.push_back(read_clocks(gpu_));
    if (sampler_) sampler_->start();
}

StampsFile PositionTruth::end() {
    StampsFile file;
    if (sampler_) {
        sampler_->stop();
        file.sampler = sampler_->summary();
        file.samples = sampler_->samples();
    }
    clock_.push_back(read_clocks(gpu_));
    file.clock = clock_;
    file.gpu = gpu_.name();
    file.sample_mean_us = static_cast<double>(sample_mean_.count()) / 1000;
    file.sample_seed = seed_;
    for (const auto& runner : runners_)
        for (std::size_t i = 0; i < runner->num_stages(); i++)
            file.streams.push_back(runner->stamped_stage(i));
    return file;
}

}  // namespace urgengo::chains
