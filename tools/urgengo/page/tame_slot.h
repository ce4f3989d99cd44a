// SPDX-License-Identifier: Apache-2.0
//
// Reckoning with a slot that another process wrote: times that cannot be true are cut, so that no
// sum or product of them overflows. True ones stay: clocks up to 9 years, durations up to 100 days.
#pragma once

#include "urgengo/abi/shared_page.h"

namespace urgengo::cli {

/// @param slot  a copy
void tame_slot(abi::TaskSlot& slot);

}  // namespace urgengo::cli
