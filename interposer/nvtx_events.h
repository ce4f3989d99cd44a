// SPDX-License-Identifier: Apache-2.0
//
// Our own events (observe/nvtx_out.h), to the NVTX tool that the process has besides us.
#pragma once

#include "host/base/settings.h"
#include "host/config/config.h"

namespace urgengo::interposer {

/// What the config and the environment say; under the start's lock.
void ask_for_nvtx_events(config::NvtxEvents configured, const Settings& settings);

/// Loads the tool and tells it from here on, if that was asked for and there is one. Once; once the
/// runtime is there, and without a lock of ours, as the tool may call the driver.
void start_nvtx_events(void* unused) noexcept;

}  // namespace urgengo::interposer
