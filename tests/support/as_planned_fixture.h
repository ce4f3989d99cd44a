// SPDX-License-Identifier: Apache-2.0
//
// Launches that need no asking, in virtual time.
#pragma once

#include "tests/support/runtime_fixture.h"

namespace urgengo::testing {

inline const CUfunction kOther = reinterpret_cast<CUfunction>(0x20);

/// The chains of RuntimeFixture, each with one segment of 20 kernels that a stream's wait closes;
/// or without a profile.
struct AsPlannedFixture : RuntimeFixture {
    explicit AsPlannedFixture(bool skips = true, bool has_profile = true) {
        may_skip = skips;
        resolved.config.scheduler.progress.mark_every =
            250us;  // alone, half of the run-ahead: five kernels
        driver.names[kOther] = "other";
        if (!has_profile) resolved.profile->chains.clear();
        close_segments();
    }

    bool planned(CUstream stream = kStreamA) {
        return launch_as_interposed(thread_a, {kConv, 100, 256, stream});
    }
};

}  // namespace urgengo::testing
