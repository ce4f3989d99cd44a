// SPDX-License-Identifier: Apache-2.0
//
// What an instance of a task needs, as parts of its chain's period.
#pragma once

#include <algorithm>

#include "host/base/memory_orders.h"
#include "host/sched/governed.h"

namespace urgengo::sched {

struct Demand {
    double gpu = 0;     ///< time that the GPU works for it
    double shared = 0;  ///< the same by the part of the GPU that its kernels take
    double gpu_and_launching = 0;
};

/// @threads any
inline Demand demand_of(const GovernedTask& task) {
    const auto busy_ns = static_cast<double>(task.estimated.gpu_ns.load(kRelaxed));
    const auto idle_ns = static_cast<double>(task.estimated.idle_ns.load(kRelaxed));
    const auto period_ns =
        static_cast<double>(std::max<std::int64_t>(task.chain->period().count(), 1));
    const double gpu = busy_ns / period_ns;
    return {gpu, 1e-6 * task.slot->mean_utilization_ppm * gpu, (busy_ns + idle_ns) / period_ns};
}

}  // namespace urgengo::sched
