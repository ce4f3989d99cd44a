// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/exec/progress_marks.h"
#include "host/identity/launch.h"

namespace urgengo::identity {

/// @param launch  of a kernel
/// @returns share of the GPU that the kernel's blocks take, 0..1: of its block slots, or of the
///          warps that keep the multiprocessors busy, whichever is more
double occupied_share(const exec::DriverApi& driver, const Launch& launch,
                      const exec::MarkContext& context);

}  // namespace urgengo::identity
