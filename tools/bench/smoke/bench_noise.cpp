// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/bench_noise.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "host/base/atomic_file.h"
#include "host/config/profile_json.h"
#include "host/config/profile_reader.h"

namespace urgengo::cli {
namespace {

/// The same on every machine, which std::uniform_real_distribution is not.
/// @returns uniform in [-1, 1)
double draw(std::mt19937_64& random) {
    return std::ldexp(static_cast<double>(random() >> 11), -52) - 1;
}

void multiply(std::vector<config::KernelProfile>& kernels, double factor) {
    for (config::KernelProfile& kernel : kernels) {
        const auto ns = std::llround(static_cast<double>(kernel.gpu_time.count()) * factor);
        // Nothing at all would be no estimate.
        kernel.gpu_time = std::chrono::nanoseconds(std::max(ns, 1LL));
    }
}

}  // namespace

void add_noise(config::Profile& profile, unsigned pct, std::uint32_t seed) {
    std::mt19937_64 random(seed);
    for (config::ChainProfile& chain : profile.chains) {
        for (config::TaskProfile& task : chain.tasks) {
            const double factor = 1 + pct / 100.0 * draw(random);
            multiply(task.kernels, factor);
            multiply(task.sizes, factor);
        }
    }
}

Result<bool> write_noisy_profile(const PlannedNoise& planned) {
    auto profile = config::read_profile(planned.source);
    if (!profile) return Error{profile.error()};
    add_noise(*profile, planned.pct, planned.seed);
    return write_file_atomically(planned.path, config::to_profile_text(*profile));
}

}  // namespace urgengo::cli
