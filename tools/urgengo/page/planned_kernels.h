// SPDX-License-Identifier: Apache-2.0
//
// Which kernel of its plan a task is at, from what the page tells of plans (abi/status_page.h) and
// of the time that is left. Nothing in the page is believed: a list that does not fit is none.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "tools/urgengo/page/page_reader.h"

namespace urgengo::cli {

class PlannedKernels {
  public:
    /// @param page  outlives it
    PlannedKernels(std::span<const std::byte> page, const abi::StatusSection& launches,
                   const abi::StatusSection& names);

    /// Sets its kernel, and the name of that, if it works on an instance and its plan is there.
    void find(const abi::TaskStatus& status, TaskReading& task);

  private:
    abi::PlannedLaunch launch(std::uint64_t index) const;
    std::string name(std::uint16_t index) const;

    std::span<const std::byte> page_;
    abi::StatusSection launches_, names_;
    std::uint64_t left_;  ///< launches that may be looked at: tasks have none in common
};

}  // namespace urgengo::cli
