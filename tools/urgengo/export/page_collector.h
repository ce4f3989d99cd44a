// SPDX-License-Identifier: Apache-2.0
//
// The pages of all processes, or of one, as metrics: pages are read at each scrape, so a process
// that has ended is gone and one that has started is there. What lies in their rings for a while
// only, the frames that ended, is followed by a thread.
#pragma once

#include <prometheus/collectable.h>

#include <condition_variable>
#include <map>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "tools/urgengo/page/find_pages.h"
#include "tools/urgengo/page/frame_follower.h"

namespace urgengo::cli {

class PageCollector : public prometheus::Collectable {
  public:
    /// @param pid  of the process, in this pid namespace; 0: all that this user may look at
    PageCollector(std::string folder, std::uint32_t pid);

    /// Starts the thread.
    void follow();

    /// @threads any
    std::vector<prometheus::MetricFamily> Collect() const override;

  private:
    std::vector<PageReading> find() const;
    void update(const std::vector<PageReading>& pages) const;
    void run(const std::stop_token& stop);

    const std::string folder_;
    const std::uint32_t pid_;
    mutable std::mutex mutex_;
    mutable std::map<std::string, std::unique_ptr<FrameFollower>> followers_;  // by stem
    std::condition_variable_any wake_;
    std::jthread thread_;  // ends first
};

}  // namespace urgengo::cli
