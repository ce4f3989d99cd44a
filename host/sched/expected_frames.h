// SPDX-License-Identifier: Apache-2.0
//
// Expected frames: the next frame of each chain takes part in a plan, a period after its last one.
// Those that should arrive within 60 ms do; a chain that is two periods late has stopped.
#pragma once

#include <optional>

#include "host/sched/tasks.h"

namespace urgengo::sched {

/// @returns the chain's next frame as a plan sees it: SlotView::kExpected
/// @threads any
std::optional<SlotView> expected_frame(const GovernedChain& chain, const Tasks& tasks,
                                       nanoseconds now);

}  // namespace urgengo::sched
