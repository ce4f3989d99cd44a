// SPDX-License-Identifier: Apache-2.0
//
// hrrn: highest response ratio next: largest (W + E) / E, where W is how long ago the frame arrived
// and E the estimated time of the whole chain.
#pragma once

#include <algorithm>

#include "host/sched/snapshot.h"

namespace urgengo::sched {

constexpr Key hrrn_key(const SlotView& v, nanoseconds now) {
    constexpr double kResolution = 1e9;
    const auto estimate =
        static_cast<double>(std::max<Key>((v.chain.cpu + v.chain.gpu).count(), 1));
    const auto waited = static_cast<double>((now - v.arrival()).count());
    return -static_cast<Key>(kResolution * std::min((waited + estimate) / estimate, 1e9));
}

}  // namespace urgengo::sched
