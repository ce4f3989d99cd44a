// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/cpu_model.h"

#include <algorithm>

namespace urgengo::sim {

void CpuModel::compute(int thread, nanoseconds work) {
    ++runnable_;
    clock_.add(static_cast<double>(work.count()), thread);
    share();
}

void CpuModel::launch(int thread, nanoseconds work) {
    ++runnable_;
    ++num_launching_;
    launching_.add(static_cast<double>(work.count()), thread);
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

void CpuModel::stall(bool is_stalled, nanoseconds now) {
    pass(now);
    is_stalled_ = is_stalled;
    share();
}

void CpuModel::pass(nanoseconds now) {
    if (!is_stalled_)
        core_ns_ +=
            static_cast<double>((now - now_).count()) * std::min(runnable_, shape_.num_cores);
    now_ = now;
    clock_.advance(now);
    launching_.advance(now);
}

const std::vector<int>& CpuModel::advance(nanoseconds now) {
    pass(now);
    done_.clear();
    while (clock_.is_due()) {
        done_.push_back(clock_.pop());
        --runnable_;
    }
    while (launching_.is_due()) {
        done_.push_back(launching_.pop());
        --runnable_;
        --num_launching_;
    }
    share();
    return done_;
}

void CpuModel::share() {
    const double cores = is_stalled_ ? 0 : shape_.num_cores;
    const double rate = std::min(1.0, cores / static_cast<double>(std::max(1, runnable_)));
    const double capacity = shape_.launch_capacity;
    const bool is_shared = capacity > 0 && num_launching_ > 1;
    clock_.set_rate(rate);
    launching_.set_rate(is_shared ? rate * capacity / (num_launching_ + capacity - 1) : rate);
}

}  // namespace urgengo::sim
