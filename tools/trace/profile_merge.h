// SPDX-License-Identifier: Apache-2.0
//
// Merges what two runs of one program taught. Pure.
#pragma once

#include "host/base/result.h"
#include "host/config/config.h"

namespace urgengo::trace {

/// Times are means, weighted by the samples (kernels) or instances (launch times, latencies, CPU
/// segments) that each was learned from; one that only one of the two knows is taken as it is. A
/// task that only one of the two knows is taken as it is; so is, where the typical instances
/// differ, the one of more instances. The newer run's driver is kept.
/// @errors one line: another program, GPU or clocks, or kernels of which neither set holds the
///         other
Result<config::Profile> merge_profiles(const config::Profile& older, const config::Profile& newer);

}  // namespace urgengo::trace
