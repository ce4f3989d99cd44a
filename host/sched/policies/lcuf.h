// SPDX-License-Identifier: Apache-2.0
//
// lcuf: lowest chain utilisation first: smallest (sum of E_cpu + sum of E_gpu) / period, in
// millionths.
//
// Source: the paper's policy figure, after J. Anderson et al. (2005).
#pragma once

#include "host/sched/snapshot.h"

namespace urgengo::sched {

constexpr Key lcuf_key(const SlotView& v) {
    const Key time_us = (v.chain.cpu + v.chain.gpu).count() / 1'000;
    const Key period_us = v.period.count() / 1'000;
    return period_us > 0 ? time_us * 1'000'000 / period_us : 0;
}

}  // namespace urgengo::sched
