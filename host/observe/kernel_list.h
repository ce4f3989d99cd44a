// SPDX-License-Identifier: Apache-2.0
//
// The launches of all plans, with the names of their kernels, as the status page has them for
// readers (abi/status_page.h): made once, when UrgenGo starts.
#pragma once

#include <cstdint>
#include <vector>

#include "host/config/config.h"
#include "urgengo/abi/status_page.h"

namespace urgengo::observe {

struct KernelList {
    std::vector<abi::PlannedLaunch> launches;
    std::vector<abi::KernelName> names;       ///< each once
    std::vector<std::uint32_t> first_launch;  ///< by task: TaskStatus::first_launch
};

/// @param profile  null: no task has a plan
/// @returns what there is room for in the page: a task's launches are there all, or none
KernelList list_kernels(const config::Config& config, const config::Profile* profile);

}  // namespace urgengo::observe
