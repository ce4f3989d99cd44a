// SPDX-License-Identifier: Apache-2.0
//
// static: one order for good, the chain with the tighter deadline first (SlotView::static_rank).
//
// Source: PAAM's default (Enright et al., RTAS 2024), as the paper uses it.
#pragma once

#include "host/sched/snapshot.h"

namespace urgengo::sched {

constexpr Key static_key(const SlotView& v) {
    return v.chain.static_rank;
}

}  // namespace urgengo::sched
