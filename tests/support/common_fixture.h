// SPDX-License-Identifier: Apache-2.0
//
// The classes of host/runtime, one at a time: the chains, driver and clock of RuntimeFixture, and
// what these classes share, without the rest of the runtime.
#pragma once

#include "host/runtime/common.h"
#include "tests/support/runtime_fixture.h"

namespace urgengo::testing {

struct CommonFixture : RuntimeFixture {
    explicit CommonFixture(config::Dispatch dispatch = config::Dispatch::kThread,
                           config::DeviceDispatch device = config::DeviceDispatch::kLeased,
                           observe::RecordOptions record = {})
        : record_(std::move(record)) {
        close_segments();
        resolved.config.scheduler.dispatch.where = dispatch;
        resolved.config.scheduler.dispatch.device = device;
    }

    /// Made at the first call: what is to be another in the config is changed before.
    runtime::Common& common() {
        if (!common_)
            common_ = std::make_unique<runtime::Common>(resolved, driver.api, clock,
                                                        runtime::TraceOptions{},
                                                        observe::ShareOptions{}, record_);
        return *common_;
    }
    runtime::TaskState& tight() { return common().roster.task(0); }
    runtime::TaskState& loose() { return common().roster.task(1); }

  private:
    const observe::RecordOptions record_;
    std::unique_ptr<runtime::Common> common_;
};

}  // namespace urgengo::testing
