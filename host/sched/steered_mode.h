// SPDX-License-Identifier: Apache-2.0
//
// What UrgenGo is to do in this process: as the config says, as the user has steered it since, or
// nothing any more.
#pragma once

#include <atomic>

#include "host/config/config.h"

namespace urgengo::sched {

/// @threads any
class SteeredMode {
  public:
    explicit SteeredMode(config::Mode mode) : mode_(mode) {}

    /// Off: every hold ends at its next look. Behind it, Tasks::changed() is due.
    void set(config::Mode mode) { mode_.store(mode); }
    config::Mode mode() const { return mode_.load(std::memory_order_relaxed); }
    /// @returns whether launches are decided about
    bool decides() const { return mode() >= config::Mode::kShadow; }
    /// @returns whether what is decided is not done
    bool only_decides() const { return mode() == config::Mode::kShadow; }
    /// @returns whether what is decided is done, as far as the mode says
    bool enforces() const { return mode() == config::Mode::kEnforce; }

  private:
    std::atomic<config::Mode> mode_;
};

}  // namespace urgengo::sched
