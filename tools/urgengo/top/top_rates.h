// SPDX-License-Identifier: Apache-2.0
//
// What two looks at the same process tell: how many cores it keeps busy, and what looks of held
// launches take of one.
#pragma once

#include <chrono>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "tools/urgengo/page/page_reader.h"

namespace urgengo::cli {

class TopRates {
  public:
    /// @returns CPU time of the process, s; none if it is not there
    using CpuTime = std::function<std::optional<double>(std::uint32_t process)>;

    /// @param cpu_time  asked of processes of this pid namespace only
    explicit TopRates(CpuTime cpu_time) : cpu_time_(std::move(cpu_time)) {}

    /// Sets `cores` and `overhead` of pages that were just read: since a look of about a second
    /// ago, or the first one. Until there are two looks, the overhead is that since UrgenGo
    /// started.
    void set(std::vector<PageReading>& pages, nanoseconds now);

  private:
    struct Look {
        nanoseconds time{0};
        std::optional<double> cpu_s;
        nanoseconds looks{0};
    };
    using Process = std::pair<std::uint64_t, std::uint32_t>;  // start, number

    CpuTime cpu_time_;
    std::map<Process, std::deque<Look>> looks_;
};

}  // namespace urgengo::cli
