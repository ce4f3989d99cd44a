// SPDX-License-Identifier: Apache-2.0
//
// The ways of opening gates, for tests of the simulator that go through all of them.
#pragma once

#include <array>

#include "host/config/presets.h"

namespace urgengo::testing {

struct GateWay {
    const char* name;
    config::Dispatch where;
    config::DeviceDispatch device = config::DeviceDispatch::kArmed;
};
inline constexpr std::array kGateWays{
    GateWay{"host", config::Dispatch::kHost},
    GateWay{"leased", config::Dispatch::kDevice, config::DeviceDispatch::kLeased},
    GateWay{"armed", config::Dispatch::kDevice, config::DeviceDispatch::kArmed},
    GateWay{"piggyback", config::Dispatch::kDevice, config::DeviceDispatch::kPiggyback}};

/// @returns the preset `urgengo`, with gates that are opened in this way
inline config::Scheduler scheduler_of(const GateWay& way) {
    config::Scheduler scheduler = *config::preset("urgengo");
    scheduler.dispatch.where = way.where;
    scheduler.dispatch.device = way.device;
    return scheduler;
}

}  // namespace urgengo::testing
