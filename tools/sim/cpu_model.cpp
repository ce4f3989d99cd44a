// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/cpu_model.h"

#include <algorithm>

namespace urgengo::sim {

void CpuModel::compute(int thread, nanoseconds work) {
    ++runnable_;
    clock_.add(static_cast<double>(work.count()), thread);
    share();
}

void CpuModel::begin_spin() {
    ++runnable_;
    share();
}

void CpuModel::end_spin() {
    --runnable_;
    share();
}

nanoseconds CpuModel::wake_up_delay() {
    const double tail = any_tail_(random_) * static_cast<double>(shape_.wake_up_tail.count());
    return shape_.wake_up + nanoseconds(static_cast<std::int64_t>(tail));
}

const std::vector<int>& CpuModel::advance(nanoseconds now) {
    core_ns_ += static_cast<double>((now - now_).count()) * std::min(runnable_, shape_.num_cores);
    now_ = now;
    done_.clear();
    clock_.advance(now);
    while (clock_.is_due()) {
        done_.push_back(clock_.pop());
        --runnable_;
    }
    share();
    return done_;
}

void CpuModel::share() {
    clock_.set_rate(std::min(
        1.0, static_cast<double>(shape_.num_cores) / static_cast<double>(std::max(1, runnable_))));
}

}  // namespace urgengo::sim
