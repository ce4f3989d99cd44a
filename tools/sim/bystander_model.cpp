// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/bystander_model.h"

#include <algorithm>

namespace urgengo::sim {
namespace {

constexpr std::uint32_t kBlockThreads = 256;
constexpr nanoseconds kWave{200'000};

KernelWork kernel_of(const BystanderSettings& settings, const GpuShape& shape) {
    const nanoseconds length = settings.length;
    if (settings.tiles > 0) {
        // A block for each multiprocessor, which does one tile after the other.
        const auto blocks = static_cast<std::uint32_t>(shape.num_sms);
        const std::uint32_t most = (settings.tiles + blocks - 1) / blocks;
        KernelWork work{blocks, static_cast<std::uint32_t>(shape.threads_per_sm)};
        work.block_ns = double(length.count());
        work.num_short = most * blocks - settings.tiles;
        work.short_ns = work.block_ns * (most - 1) / most;
        return work;
    }
    const auto per_sm = static_cast<std::uint32_t>(shape.threads_per_sm) / kBlockThreads;
    const auto waves = static_cast<std::uint32_t>(std::max<std::int64_t>(1, length / kWave));
    KernelWork work;
    work.blocks = waves * per_sm * static_cast<std::uint32_t>(shape.num_sms);
    work.block_threads = kBlockThreads;
    work.block_ns = double(kWave.count()) / per_sm;
    return work;
}

}  // namespace

BystanderModel::BystanderModel(const BystanderSettings& settings, int thread, nanoseconds until,
                               ChainSurroundings& surroundings, Subject& subject)
    : settings_(settings),
      thread_(thread),
      until_(until),
      surroundings_(surroundings),
      subject_(subject),
      kernel_(kernel_of(settings, surroundings.gpu_shape())) {}

void BystanderModel::go_on(nanoseconds now) {
    switch (state_) {
        case State::kLaunching:
            if (now >= until_) return;
            if (settings_.before.count() == 0) return launch(now);
            state_ = State::kComputing;
            return surroundings_.compute(thread_, settings_.before);
        case State::kComputing:
            return launch(now);
        case State::kAsleep:
            return wait(now);
        case State::kWaiting:
            return waited(now);
    }
}

void BystanderModel::launch(nanoseconds now) {
    for (int i = 0; i < settings_.ahead; ++i) {
        surroundings_.launch(thread_, 0, kernel_);
        subject_.bystander_launched(now);
    }
    if (settings_.tiles > 0) return wait(now);
    state_ = State::kAsleep;
    surroundings_.wake_at(thread_, now + settings_.length, true);
}

void BystanderModel::wait(nanoseconds now) {
    state_ = State::kWaiting;
    if (surroundings_.wait(thread_)) waited(now);
}

void BystanderModel::waited(nanoseconds now) {
    state_ = State::kLaunching;
    next_ = std::max(next_ + settings_.period, now);
    surroundings_.wake_at(thread_, next_, next_ > now);
}

}  // namespace urgengo::sim
