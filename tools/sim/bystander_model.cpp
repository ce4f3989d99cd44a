// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/bystander_model.h"

#include <algorithm>

namespace urgengo::sim {
namespace {

constexpr std::uint32_t kBlockThreads = 256;
constexpr nanoseconds kWave{200'000};

KernelWork kernel_of(nanoseconds length, const GpuShape& shape) {
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
      kernel_(kernel_of(settings.length, surroundings.gpu_shape())) {}

void BystanderModel::go_on(nanoseconds now) {
    switch (state_) {
        case State::kLaunching:
            if (now >= until_) return;
            surroundings_.launch(thread_, kernel_);
            subject_.bystander_launched(now);
            state_ = State::kAsleep;
            return surroundings_.wake_at(thread_, now + settings_.length, true);
        case State::kAsleep:
            state_ = State::kWaiting;
            if (surroundings_.wait(thread_)) waited(now);
            return;
        case State::kWaiting:
            return waited(now);
    }
}

void BystanderModel::waited(nanoseconds now) {
    state_ = State::kLaunching;
    next_ = std::max(next_ + settings_.period, now);
    surroundings_.wake_at(thread_, next_, next_ > now);
}

}  // namespace urgengo::sim
