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
    /// @param only_decides  what is decided is not done: mode `shadow`
    void set(config::Mode mode, bool only_decides = false) {
        // In this order, or what is to be only decided would be done for a moment.
        if (only_decides) only_decides_.store(true);
        mode_.store(mode);
        if (!only_decides) only_decides_.store(false);
    }
    config::Mode mode() const { return mode_.load(std::memory_order_relaxed); }
    bool only_decides() const { return only_decides_.load(std::memory_order_relaxed); }
    /// @returns whether what is decided is done, as far as the mode says
    bool enforces() const { return mode() == config::Mode::kEnforce && !only_decides(); }

  private:
    std::atomic<config::Mode> mode_;
    std::atomic<bool> only_decides_{false};
};

}  // namespace urgengo::sched
