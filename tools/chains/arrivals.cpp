// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/arrivals.h"

#include <algorithm>
#include <random>

#include "tools/chains/spec.h"

namespace urgengo::chains {

using std::chrono::nanoseconds;

namespace {

nanoseconds from_ms(double ms) {
    return nanoseconds{static_cast<std::int64_t>(ms * 1e6)};
}

/// The sizes of one frame's inputs, from random numbers of its own, so that frames arrive at the
/// same times whether they vary or not.
std::vector<double> draw_sizes(const Chain& chain, std::size_t chain_index, std::uint32_t frame,
                               const ArrivalSettings& settings) {
    std::seed_seq seed{settings.seed, static_cast<std::uint32_t>(chain_index), frame};
    std::mt19937 random(seed);
    std::vector<double> sizes;
    for (const Task& task : chain.tasks) {
        std::uniform_int_distribution<int> any_inputs(task.min_inputs, task.max_inputs);
        const double middle = (task.min_inputs + task.max_inputs) / 2.0;
        sizes.push_back(settings.variable ? any_inputs(random) / middle : 1);
    }
    return sizes;
}

}  // namespace

std::vector<PlannedFrame> plan_frames(const Chain& chain, std::size_t chain_index,
                                      const ArrivalSettings& settings) {
    // Seed 1 gives the phases of the published prototype measurements. How chains' phases fall
    // decides much of how hard a scenario is: compare over several seeds.
    std::mt19937 random(1000 * settings.seed + static_cast<std::uint32_t>(chain_index));
    std::uniform_real_distribution<double> any_jitter_ms(0, kJitterMs);
    std::uniform_real_distribution<double> any_cpu_factor(0.9, 1.1);
    std::uniform_real_distribution<double> any_phase(0, 1);

    std::vector<PlannedFrame> frames;
    nanoseconds nominal{
        static_cast<std::int64_t>(any_phase(random) * double(settings.period.count()))};
    for (std::uint32_t i = 0; nominal < settings.duration; nominal += settings.period, i++) {
        PlannedFrame frame;
        frame.size = draw_sizes(chain, chain_index, i, settings);
        frame.arrival = nominal + from_ms(any_jitter_ms(random));
        for (const Task& task : chain.tasks) {
            frame.cpu.push_back(from_ms(task.cpu_ms * any_cpu_factor(random)));
        }
        if (frame.arrival < settings.duration) frames.push_back(std::move(frame));
    }
    // Only where the period is shorter than the jitter do frames overtake each other.
    std::stable_sort(
        frames.begin(), frames.end(),
        [](const PlannedFrame& a, const PlannedFrame& b) { return a.arrival < b.arrival; });
    return frames;
}

}  // namespace urgengo::chains
