// SPDX-License-Identifier: Apache-2.0
//
// Positive twins: whatever UrgenGo is set up to do, a program's output and end are what they are
// without it, and UrgenGo says nothing but the one line that says why it does nothing.
#pragma once

#include "tests/interposer/run_twin.h"

namespace urgengo::testing {

struct Scenario {
    const char* name;
    int exit_status = 0;
    int starts = 1;                ///< processes that launch or hint, and so start UrgenGo
    bool reports = true;           ///< ends so that statistics are written, of launches
    bool holds = false;            ///< some launches are certain to be held when UrgenGo schedules
    Environment environment = {};  ///< in every run
    bool shows_streams = false;    ///< prints which stream a kernel ran on, which a pool changes
};

/// @returns the environment with more in it
Environment with(const Environment& more, Environment environment);

/// Runs the scenario bare and under every set-up, and compares.
void check_twin(const Scenario& scenario, const char* program = TWIN_PATH);

}  // namespace urgengo::testing
